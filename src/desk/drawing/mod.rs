//! Drawing: SVG, axes, labels that keep clear of each other. For figures in print and for pages on a screen.

pub mod axes;
pub mod labels;
pub mod svg;
