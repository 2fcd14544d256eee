//! Data set of the demo, embedded in the program.

use crate::{failure::Failure, output};
use include_dir::{Dir, include_dir};
use std::path::Path;

static DATA: Dir<'_> = include_dir!("$CARGO_MANIFEST_DIR/data/demo");

/// Writes the data set to a folder.
pub(super) fn unpack(folder: &Path) -> Result<(), Failure> {
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
    use specula_report::demo::LIGHTS;

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
        for light in LIGHTS.into_iter().chain(["workshop"]) {
            assert!(DATA.get_file(format!("light/{light}.hdr")).is_some(), "{light} is missing");
        }
    }
}
