//! The path of a file in which others have drawn the field.

use std::path::{Path, PathBuf};

use serde_json::{Value as Json, json};

use super::value::{Fault, Item, Kind, wrong_type};
use crate::config::area_file::AreaFile;

/// What the file says that a string names: see [`AreaFile`].
pub(crate) struct FieldFile {
    /// Where a relative path begins.
    pub(crate) directory: PathBuf,
}

impl Kind for FieldFile {
    type Out = AreaFile;

    fn read(&self, item: &Item<'_>, faults: &mut Vec<Fault>) -> Option<AreaFile> {
        let Some(path) = item.get_ref().as_str() else {
            wrong_type(self, item, faults);
            return None;
        };
        AreaFile::read(&self.directory.join(Path::new(path)))
            .map_err(|why| {
                faults.push(Fault { at: item.span(), clause: format!("is {path:?}: the file {why}") })
            })
            .ok()
    }

    fn fault(&self, _: &AreaFile) -> Option<String> {
        None
    }

    fn expected(&self) -> String {
        "the path of a QGroundControl plan (.plan) or of a GeoJSON file (.geojson)".to_owned()
    }

    fn schema(&self) -> Json {
        json!({ "type": "string", "minLength": 1 })
    }

    /// Its contents are recorded as the settings that they stand for.
    fn canonical(&self, _: &AreaFile) -> Json {
        Json::Null
    }
}
