//! Light in levels of roughness: a lat-long map becomes a cube, and the cube one smaller cube for
//! each roughness.
//!
//! `prefilter [ENV.hdr]` prints what a loader of an engine uploads: resolution and roughness of
//! each level, and its mean. `specula prefilter` writes the same as KTX2 or EXR.

use core::error::Error;
use specula_core::{
    prefilter::{Levels, PrefilterScheme},
    scene::{Environment, RadianceActivation},
};
use specula_cpu::CpuExecutor;
use specula_io::latlong::{self, LatLong, UpAxis};
use std::path::Path;

/// Texels along an edge of the first level's faces.
const RESOLUTION: usize = 64;

/// A sky with a sun, where no file is named.
fn sky() -> LatLong {
    let (width, height) = (64, 32);
    let radiance = |index: usize| {
        let (x, y) = (index % width, index / width);
        if (x, y) == (20, 8) { [200.0, 180.0, 150.0] } else { [0.3, 0.4, 1.0 - y as f32 / height as f32] }
    };
    LatLong { width, height, rgb: (0..width * height).flat_map(radiance).collect() }
}

/// Resolution, roughness and mean radiance of each level.
fn levels_of(map: &LatLong) -> Result<Vec<(usize, f32, f32)>, Box<dyn Error>> {
    let values = latlong::to_cube(map, RESOLUTION, UpAxis::Z);
    let base = Environment { resolution: RESOLUTION, activation: RadianceActivation::Identity, values };
    let levels = Levels::new(PrefilterScheme::Exact, RESOLUTION);
    let light = CpuExecutor::new().prefilter_into(&base, PrefilterScheme::Exact, levels)?;
    let facts = light.levels().iter().enumerate().map(|(index, level)| {
        // Six faces of RGB, one after the other: what a cube map's upload takes.
        let texels = light.faces(index);
        (level.resolution, level.roughness, texels.iter().sum::<f32>() / texels.len() as f32)
    });
    Ok(facts.collect())
}

fn main() -> Result<(), Box<dyn Error>> {
    let map = match std::env::args().nth(1).filter(|name| name.ends_with(".hdr") || name.ends_with(".exr")) {
        Some(path) => latlong::read(Path::new(&path))?.0,
        None => sky(),
    };
    for (resolution, roughness, mean) in levels_of(&map)? {
        println!("{resolution:3} × {resolution:<3} roughness {roughness:.3}, mean {mean:.3}");
    }
    Ok(())
}

#[test]
fn light_that_is_the_same_everywhere_stays_so() {
    main().unwrap();
    let grey = LatLong { width: 8, height: 4, rgb: vec![0.5; 3 * 8 * 4] };
    for (_, roughness, mean) in levels_of(&grey).unwrap() {
        assert!((mean - 0.5).abs() < 1e-5, "{mean} at a roughness of {roughness}");
    }
}
