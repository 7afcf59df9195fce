//! The report's drawings. Each that must be legible on a page and on a phone is drawn twice, and the style sheet shows one.

pub mod ground;
pub mod secrecy;
pub mod series;
pub mod strips;
pub mod time;

use crate::desk::drawing::svg::Theme;
use crate::role::Role;

/// For which width a drawing is made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// A page on a screen or on paper.
    Wide,
    /// A phone.
    Narrow,
}

impl Format {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Wide, Self::Narrow];

    /// Width of a drawing across the page, in CSS pixels.
    #[must_use]
    pub fn width(self) -> f64 {
        match self {
            Self::Wide => 920.0,
            Self::Narrow => 343.0,
        }
    }

    /// Its class in the style sheet, and the end of its identifiers.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Wide => "wide",
            Self::Narrow => "narrow",
        }
    }
}

/// The page's colours; the style sheet knows them for light and for dark.
pub const THEME: Theme = Theme { paper: "var(--paper)", ink: "var(--ink)", grid: "var(--grid)", text: 11.5 };
/// For a map on coloured ground, which is the same in light and in dark, with figures around it that are not.
pub const GROUND_THEME: Theme = Theme { paper: "#ffffff", ink: "var(--ink)", grid: "none", text: 11.5 };

/// A vehicle's colour.
#[must_use]
pub fn colour(role: Role) -> &'static str {
    match role {
        Role::I => "var(--i)",
        Role::J => "var(--j)",
    }
}

/// A vehicle's colour for what is behind its line.
#[must_use]
pub fn faint(role: Role) -> &'static str {
    match role {
        Role::I => "var(--i-faint)",
        Role::J => "var(--j-faint)",
    }
}
