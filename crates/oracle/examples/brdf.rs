//! Error of the paper's specular light, a tint times a lobe around the mirrored direction, against
//! a whole microfacet reflectance (`specula_oracle::independent::brdf`). Both are computed by
//! quadrature, without a prefilter.
//!
//! ```sh
//! cargo run --release -p specula-oracle --example brdf
//! ```

use rayon::prelude::*;
use specula_oracle::independent::{
    brdf::{Reflected, reflected},
    lobe::{CubeMap, filtered, studio},
};

const ROUGHNESS: [f64; 5] = [0.1, 0.2, 0.3, 0.5, 0.8];
const N_DOT_V: [f64; 4] = [0.95, 0.7, 0.4, 0.2];
/// Mirrored directions of each number.
const DIRECTIONS: usize = 40;
/// Texels along an edge of the light's faces, and samples along an edge of a texel.
const RESOLUTION: usize = 32;
const SAMPLES: usize = 8;
/// Each light's name, its first number, and how many it has.
const LIGHTS: [(&str, usize, usize); 4] = [
    ("the same everywhere", 0, 1),
    ("brighter upwards", 1, 1),
    ("studio, as shown", 2, 3),
    ("studio, sun of 200", 5, 3),
];
const NUMBERS: usize = 8;

/// Radiance towards the eye under all lights.
struct Reflection {
    /// Under the whole reflectance.
    whole: Reflected<NUMBERS>,
    /// Under the lobe.
    lobe: [f64; NUMBERS],
}

fn main() {
    let map = CubeMap::new(RESOLUTION, SAMPLES, studio);
    let light = |light_dir: [f64; 3]| {
        let [a, b, c, d, e, f] = map.sample(light_dir);
        [1.0, 1.0 + 0.8 * light_dir[2], a, b, c, d, e, f]
    };
    println!("| light | n·v | {} |", ROUGHNESS.map(|roughness| format!("ρ = {roughness}")).join(" | "));
    println!("|---|---|{}", "---|".repeat(ROUGHNESS.len()));
    let table = N_DOT_V.map(|n_dot_v| ROUGHNESS.map(|roughness| reflections_of(&light, n_dot_v, roughness)));
    for (name, first, count) in LIGHTS {
        for (n_dot_v, row) in N_DOT_V.iter().zip(&table) {
            let cells: Vec<String> = row.iter().map(|reflections| cell(reflections, first..first + count)).collect();
            println!("| {name} | {n_dot_v} | {} |", cells.join(" | "));
        }
    }
}

fn reflections_of(
    light: &(impl Fn([f64; 3]) -> [f64; NUMBERS] + Sync),
    n_dot_v: f64,
    roughness: f64,
) -> Vec<Reflection> {
    let one = |k: usize| {
        let (normal, to_eye) = normal_and_eye(k, n_dot_v);
        let mirrored = core::array::from_fn(|c| 2.0 * n_dot_v * normal[c] - to_eye[c]);
        Reflection {
            whole: reflected(light, normal, to_eye, roughness, RESOLUTION),
            lobe: filtered(light, mirrored, roughness, RESOLUTION),
        }
    };
    (0..DIRECTIONS).into_par_iter().map(one).collect()
}

/// A normal, from a spiral over the sphere, and a direction to the eye, turned about it by golden
/// angles.
fn normal_and_eye(k: usize, n_dot_v: f64) -> ([f64; 3], [f64; 3]) {
    let golden = core::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let z = 1.0 - (2 * k + 1) as f64 / DIRECTIONS as f64;
    let (radius, (sin, cos)) = ((1.0 - z * z).sqrt(), (golden * k as f64).sin_cos());
    let normal = [radius * cos, radius * sin, z];
    let (across, up) = ([-sin, cos, 0.0], [-z * cos, -z * sin, radius]);
    let (sine, (turn_sin, turn_cos)) = ((1.0 - n_dot_v * n_dot_v).sqrt(), (golden * (k * k) as f64).sin_cos());
    let to_eye = core::array::from_fn(|c| n_dot_v * normal[c] + sine * (turn_cos * across[c] + turn_sin * up[c]));
    (normal, to_eye)
}

/// Errors √(Σ |model − whole|² / Σ |whole|²): of the paper's term for tints of 1 and of 0.04, and
/// of the lobe times the share of light that the whole reflectance sends back, for a tint of 1.
fn cell(reflections: &[Reflection], numbers: core::ops::Range<usize>) -> String {
    let paper = |tint: f64| error(reflections, numbers.clone(), tint, |_| tint);
    let share = error(reflections, numbers.clone(), 1.0, |whole| whole.of(0, 1.0));
    format!("{:.3} / {:.3} / {share:.3}", paper(1.0), paper(0.04))
}

fn error(
    reflections: &[Reflection],
    numbers: core::ops::Range<usize>,
    f0: f64,
    scale: impl Fn(&Reflected<NUMBERS>) -> f64,
) -> f64 {
    let (mut difference, mut total) = (0.0, 0.0);
    for Reflection { whole, lobe } in reflections {
        for k in numbers.clone() {
            let truth = whole.of(k, f0);
            difference += (scale(whole) * lobe[k] - truth).powi(2);
            total += truth * truth;
        }
    }
    (difference / total).sqrt()
}
