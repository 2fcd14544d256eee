//! Files embedded in the program: the demo's data set and its lights.

use crate::{failure::Failure, output};
use include_dir::{Dir, File, include_dir};
use std::path::Path;

static DATA: Dir<'_> = include_dir!("$CARGO_MANIFEST_DIR/data/demo");

/// Names of the lights.
pub(crate) const LIGHTS: [&str; 3] = ["sunset", "forest", "workshop"];

/// Lat-long map of a light (.hdr) by its name.
pub(crate) fn light(name: &str) -> Option<&'static [u8]> {
    let name = LIGHTS.into_iter().find(|light| *light == name)?;
    DATA.get_file(format!("light/{name}.hdr")).map(File::contents)
}

/// Writes the data set to a folder.
pub(crate) fn unpack(folder: &Path) -> Result<(), Failure> {
    unpack_all(&DATA, folder)
}

fn unpack_all(from: &Dir<'_>, folder: &Path) -> Result<(), Failure> {
    for file in from.files() {
        output::write_within(folder, file.path(), file.contents())?;
    }
    from.dirs().try_for_each(|dir| unpack_all(dir, folder))
}

#[cfg(test)]
mod tests {
    use super::*;
    use specula_report::demo;

    #[test]
    fn the_scene_is_small() {
        fn size(dir: &Dir<'_>) -> usize {
            let files: usize = dir.files().map(|file| file.contents().len()).sum();
            files + dir.dirs().map(size).sum::<usize>()
        }
        assert!(size(&DATA) <= 2_000_000, "the demo's data has grown to {} bytes", size(&DATA));
    }

    #[test]
    fn the_scene_has_what_the_demo_shows() {
        for name in demo::LIGHTS.into_iter().chain(LIGHTS) {
            assert!(light(name).is_some(), "{name} is missing");
        }
        assert!(light("noon").is_none());
    }
}
