//! Shading of surface points, row by row.

use crate::{
    arrays::{Floats, array, rows},
    errors::{Failure, Result},
    light::{PrefilteredLight, directions_of},
    threads::compute,
};
use numpy::PyArrayDyn;
use pyo3::prelude::*;
use rayon::prelude::*;
use specula_core::{
    ggx::distribution,
    physical::{PixelLight, pixel_color, reflectances},
    shade::{N_DOT_V_MIN, ShadingForm, Terms, reflect},
    shade_pixels::PixelSurface,
    split_sum::integrate,
    vector::{Vec3, normalize_or, vec3},
};

/// Half vectors of an integral: it comes within 2e-4.
const SAMPLES: u32 = 1024;

/// Density of the GGX distribution at rows of cosines and roughnesses.
#[pyfunction]
pub(crate) fn ggx<'py>(
    py: Python<'py>,
    n_dot_h: &Bound<'py, PyAny>,
    roughness: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    let cosines = shares(n_dot_h, "n_dot_h")?;
    let roughness = shares(roughness, "roughness")?;
    let pairs = cosines.values().par_iter().zip(roughness.values());
    let density = |(cosine, rough): (&f32, &f32)| distribution(f64::from(*cosine), f64::from(rough * rough)) as f32;
    let values: Vec<f32> = compute(py, || pairs.map(density).collect())?;
    Ok(array(py, values, &[cosines.values().len()])?)
}

/// Scale and bias of the split-sum approximation at rows of cosines and roughnesses.
#[pyfunction]
pub(crate) fn split_sum<'py>(
    py: Python<'py>,
    n_dot_v: &Bound<'py, PyAny>,
    roughness: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    let cosines = shares(n_dot_v, "n_dot_v")?;
    let roughness = shares(roughness, "roughness")?;
    let pairs = cosines.values().par_iter().zip(roughness.values());
    let values: Vec<[f32; 2]> = compute(py, || pairs.map(|(cosine, rough)| scale_and_bias(*cosine, *rough)).collect())?;
    Ok(rows(py, values, &[cosines.values().len(), 2])?)
}

fn scale_and_bias(n_dot_v: f32, roughness: f32) -> [f32; 2] {
    integrate(f64::from(n_dot_v.max(N_DOT_V_MIN)), f64::from(roughness), SAMPLES).map(|number| number as f32)
}

/// Numbers from 0 to 1.
fn shares<'py>(value: &Bound<'py, PyAny>, name: &str) -> Result<Floats<'py>> {
    let numbers = Floats::new(value, name)?.shaped(name, "[N]")?;
    match numbers.values().iter().find(|number| !(0.0..=1.0).contains(*number)) {
        Some(number) => Err(Failure::input(format!("{name} holds {number}; use numbers from 0 to 1"))),
        None => Ok(numbers),
    }
}

/// Row of three numbers as a vector.
fn of([x, y, z]: [f32; 3]) -> Vec3<f32> {
    vec3(x, y, z)
}

/// Directions of rows of surface points.
struct Points {
    normals: Vec<Vec3<f32>>,
    reflected: Vec<[f32; 3]>,
    n_dot_v: Vec<f32>,
}

impl Points {
    fn new(normals: &[[f32; 3]], view_dirs: &[[f32; 3]]) -> Self {
        let unit = |row: &[f32; 3]| normalize_or(of(*row), of([0.0, 0.0, 1.0]));
        let normals: Vec<Vec3<f32>> = normals.iter().map(unit).collect();
        let views: Vec<Vec3<f32>> = view_dirs.iter().map(unit).collect();
        let pairs = || views.iter().zip(&normals);
        Self {
            reflected: pairs().map(|(view, normal)| reflect(*view, *normal).to_array()).collect(),
            n_dot_v: pairs().map(|(view, normal)| view.dot(*normal).clamp(N_DOT_V_MIN, 1.0)).collect(),
            normals,
        }
    }

    fn normals(&self) -> Vec<[f32; 3]> {
        self.normals.iter().map(|normal| normal.to_array()).collect()
    }
}

/// Colours of rows of surface points by the shading function of the paper or of the authors' code.
#[pyfunction]
pub(crate) fn shade<'py>(
    py: Python<'py>,
    light: &PrefilteredLight,
    normals: &Bound<'py, PyAny>,
    view_dirs: &Bound<'py, PyAny>,
    diffuse: &Bound<'py, PyAny>,
    tint: &Bound<'py, PyAny>,
    roughness: &Bound<'py, PyAny>,
    residual: &Bound<'py, PyAny>,
    form: &str,
) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    let form = match form {
        "paper" => ShadingForm::Paper,
        "official" => ShadingForm::Official,
        _ => return Err(Failure::input(format!("{form:?} is no shading function; use paper or official")).into()),
    };
    let [normals, view_dirs] = [directions_of(normals, "normals")?, directions_of(view_dirs, "view_dirs")?];
    let [diffuse, tint, residual] = [colors(diffuse, "diffuse")?, colors(tint, "tint")?, colors(residual, "residual")?];
    let roughness = shares(roughness, "roughness")?;
    let [normals, views] = [normals.rows(), view_dirs.rows()];
    let [diffuse, tint, residual] = [diffuse.rows(), tint.rows(), residual.rows()];
    let rough = roughness.values();
    let shaded: Vec<[f32; 3]> = compute(py, || {
        let points = Points::new(normals, views);
        let specular = light.radiance(&points.reflected, rough);
        let ambient = light.irradiance_of(&points.normals());
        let color = |index: usize| {
            let split_sum = match form {
                ShadingForm::Official => scale_and_bias(points.n_dot_v[index], rough[index]),
                _ => [0.0; 2],
            };
            let terms = Terms {
                diffuse: of(diffuse[index]),
                tint: of(tint[index]),
                specular_light: of(specular[index]),
                residual: of(residual[index]),
                ambient_light: of(ambient[index]),
                split_sum,
            };
            specula_core::shade::shade(form, &terms).to_array()
        };
        (0..rough.len()).into_par_iter().map(color).collect()
    })?;
    Ok(rows(py, shaded, &[rough.len(), 3])?)
}

/// Colours of rows of surface points of physical materials.
#[pyfunction]
pub(crate) fn shade_physical<'py>(
    py: Python<'py>,
    light: &PrefilteredLight,
    normals: &Bound<'py, PyAny>,
    view_dirs: &Bound<'py, PyAny>,
    albedo: &Bound<'py, PyAny>,
    metalness: &Bound<'py, PyAny>,
    roughness: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    let [normals, view_dirs] = [directions_of(normals, "normals")?, directions_of(view_dirs, "view_dirs")?];
    let albedo = colors(albedo, "albedo")?;
    let [metalness, roughness] = [shares(metalness, "metalness")?, shares(roughness, "roughness")?];
    let [normals, views, albedo] = [normals.rows(), view_dirs.rows(), albedo.rows()];
    let (metal, rough) = (metalness.values(), roughness.values());
    let shaded: Vec<[f32; 3]> = compute(py, || {
        let points = Points::new(normals, views);
        let specular = light.radiance(&points.reflected, rough);
        let irradiance = light.irradiance_of(&points.normals());
        let color = |index: usize| {
            let [base, tint] = reflectances(of(albedo[index]), metal[index]);
            let reflection_dir = of(points.reflected[index]);
            let surface = PixelSurface { base, tint, roughness: rough[index], reflection_dir };
            let light = PixelLight {
                specular: of(specular[index]),
                irradiance: of(irradiance[index]),
                split_sum: scale_and_bias(points.n_dot_v[index], rough[index]),
            };
            pixel_color(&surface, &light, 1.0).to_array()
        };
        (0..rough.len()).into_par_iter().map(color).collect()
    })?;
    Ok(rows(py, shaded, &[rough.len(), 3])?)
}

/// Rows of finite colours.
fn colors<'py>(value: &Bound<'py, PyAny>, name: &str) -> Result<Floats<'py>> {
    Floats::new(value, name)?.shaped(name, "[N, 3]")?.finite(name)
}
