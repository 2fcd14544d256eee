//! Lights: environment maps, suns and lamps, and the levels that an environment is filtered into.

use crate::{
    arrays::{Floats, array},
    errors::{Failure, Result},
    threads::{compute, try_compute},
};
use core::str::FromStr;
use numpy::PyArrayDyn;
use pyo3::prelude::*;
use specula_core::{
    prefilter::{IRRADIANCE_RESOLUTION, Level, Levels, PrefilterScheme, level_of_roughness},
    scene::{Environment, RadianceActivation},
};
use specula_cpu::CpuExecutor;
use specula_io::{
    Input,
    latlong::{self, LatLong, UpAxis, radiance_along},
};
use specula_scene::{
    Lighting,
    lamps::{SphereChoice, SunChoice},
    light_file::{self, MapUp},
};
use std::path::PathBuf;

/// Light that replaces that of a scene: an environment map, suns and lamps.
#[pyclass(frozen, module = "specula_gs", from_py_object)]
#[derive(Clone, Debug)]
pub(crate) struct Light {
    /// The light, without a surface that casts shadows.
    pub(crate) lighting: Lighting,
}

#[pymethods]
impl Light {
    /// Light of a file: a lat-long map of linear radiance.
    #[staticmethod]
    #[pyo3(signature = (path, *, up="scene", exposure=0.0))]
    fn load(py: Python<'_>, path: PathBuf, up: &str, exposure: f32) -> PyResult<Self> {
        let map_up = parsed(up.to_owned(), MapUp::try_from)?;
        let (mut map, _) = try_compute(py, || Ok(light_file::read(Input::file(&path))?))?;
        map.rgb.iter_mut().for_each(|number| *number *= exposure.exp2());
        Ok(Self { lighting: Lighting { map: Some(map), map_up, ..Lighting::default() } })
    }

    /// Light of a lat-long map [H, W, 3] of linear radiance.
    #[staticmethod]
    #[pyo3(signature = (map, *, up="scene"))]
    fn from_latlong(map: &Bound<'_, PyAny>, up: &str) -> PyResult<Self> {
        let map_up = parsed(up.to_owned(), MapUp::try_from)?;
        Ok(Self { lighting: Lighting { map: Some(map_of(map, "map")?), map_up, ..Lighting::default() } })
    }

    /// Darkness, to which suns and lamps can be added.
    #[staticmethod]
    fn dark() -> Self {
        Self { lighting: Lighting::default() }
    }

    /// The same light and a sun.
    #[pyo3(signature = (azimuth, elevation, *, strength=3.0, diameter=0.53, color="ffffff"))]
    fn with_sun(&self, azimuth: f32, elevation: f32, strength: f32, diameter: f32, color: &str) -> PyResult<Self> {
        let sun: SunChoice =
            parsed(format!("{azimuth},{elevation},{strength},{diameter}:{color}"), |text| SunChoice::from_str(&text))?;
        let mut lighting = self.lighting.clone();
        lighting.suns.push(sun);
        Ok(Self { lighting })
    }

    /// The same light and a lamp.
    #[pyo3(signature = (position, strength, *, radius=0.0, color="ffffff"))]
    fn with_lamp(&self, position: [f32; 3], strength: f32, radius: f32, color: &str) -> PyResult<Self> {
        let [x, y, z] = position;
        let lamp: SphereChoice =
            parsed(format!("{x},{y},{z},{strength},{radius}:{color}"), |text| SphereChoice::from_str(&text))?;
        let mut lighting = self.lighting.clone();
        lighting.spheres.push(lamp);
        Ok(Self { lighting })
    }

    /// The same light, its map and its suns turned about the up direction.
    fn turned(&self, degrees: f32) -> PyResult<Self> {
        if !degrees.is_finite() {
            return Err(Failure::input(format!("degrees is {degrees}; use a finite number")).into());
        }
        Ok(Self { lighting: Lighting { turn: self.lighting.turn + degrees, ..self.lighting.clone() } })
    }

    /// Environment map [H, W, 3]; none for darkness.
    #[getter]
    fn latlong<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArrayDyn<f32>>>> {
        let map = self.lighting.map.as_ref();
        Ok(map.map(|map| array(py, map.rgb.clone(), &[map.height, map.width, 3])).transpose()?)
    }

    /// Number of suns and lamps.
    #[getter]
    fn lamp_count(&self) -> usize {
        self.lighting.suns.len() + self.lighting.spheres.len()
    }

    fn __repr__(&self) -> String {
        let map = self.lighting.map.as_ref();
        let map = map.map_or("dark".to_owned(), |map| format!("{} × {} px", map.width, map.height));
        format!("Light({map}, {} suns and lamps)", self.lamp_count())
    }
}

/// Value of a text that a parser of the project reads.
pub(crate) fn parsed<S, T, E: core::fmt::Display>(
    text: S,
    parse: impl FnOnce(S) -> core::result::Result<T, E>,
) -> Result<T>
where
    S: core::fmt::Display + Clone,
{
    parse(text.clone()).map_err(|error| Failure::input(format!("{text:} is not understood; {error}")))
}

/// Lat-long map of an array [H, W, 3].
fn map_of(value: &Bound<'_, PyAny>, name: &str) -> Result<LatLong> {
    let map = Floats::new(value, name)?.shaped(name, "[H, W, 3]")?.finite(name)?;
    let (height, width) = (map.shape()[0], map.shape()[1]);
    if height == 0 || width == 0 || map.values().iter().any(|number| *number < 0.0) {
        return Err(Failure::input(format!("{name} is no radiance; use numbers of 0 or more in at least one pixel")));
    }
    Ok(LatLong { width, height, rgb: map.values().to_vec() })
}

/// Axis at the upper edge of a map.
fn axis_of(up: &str) -> Result<UpAxis> {
    match up {
        "y" => Ok(UpAxis::Y),
        "z" => Ok(UpAxis::Z),
        _ => Err(Failure::input(format!("{up:?} is no up axis; use y or z"))),
    }
}

/// Faces of a cube map and their resolution.
fn cube_of(value: &Bound<'_, PyAny>) -> Result<(Vec<f32>, usize)> {
    let cube = Floats::new(value, "cube")?.shaped("cube", "[6, N, N, 3]")?.finite("cube")?;
    let resolution = cube.shape()[1];
    if resolution == 0 || cube.shape()[2] != resolution {
        return Err(Failure::input(format!("cube has the shape {:?}; use [6, N, N, 3]", cube.shape())));
    }
    Ok((cube.values().to_vec(), resolution))
}

/// Cube map of a lat-long map.
#[pyfunction]
#[pyo3(signature = (map, resolution, *, up="z"))]
pub(crate) fn latlong_to_cube<'py>(
    py: Python<'py>,
    map: &Bound<'py, PyAny>,
    resolution: usize,
    up: &str,
) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    let (map, up) = (map_of(map, "map")?, axis_of(up)?);
    check_resolution(resolution)?;
    let cube = compute(py, || latlong::to_cube(&map, resolution, up))?;
    Ok(array(py, cube, &[6, resolution, resolution, 3])?)
}

/// Lat-long map of a cube map.
#[pyfunction]
#[pyo3(signature = (cube, height, *, up="z"))]
pub(crate) fn cube_to_latlong<'py>(
    py: Python<'py>,
    cube: &Bound<'py, PyAny>,
    height: usize,
    up: &str,
) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    let ((values, resolution), up) = (cube_of(cube)?, axis_of(up)?);
    check_resolution(height)?;
    let map = compute(py, || latlong::from_cube(&values, resolution, 2 * height, height, up))?;
    Ok(array(py, map.rgb, &[height, 2 * height, 3])?)
}

/// Refuses sizes of maps without a pixel or with more than memory holds.
fn check_resolution(resolution: usize) -> Result<()> {
    const MOST: usize = 1 << 13;
    match resolution {
        1..=MOST => Ok(()),
        _ => Err(Failure::input(format!("a map of {resolution} rows is not made; use 1 to {MOST}"))),
    }
}

/// Environment, filtered into levels of roughness.
#[pyclass(frozen, module = "specula_gs")]
#[derive(Debug)]
pub(crate) struct PrefilteredLight {
    levels: Vec<Level>,
    /// Faces of each level.
    faces: Vec<Vec<f32>>,
    /// Irradiance / π, as a cube map of this resolution.
    irradiance: (Vec<f32>, usize),
}

impl PrefilteredLight {
    /// Radiance along directions, each at a roughness: linear between the levels.
    pub(crate) fn radiance(&self, directions: &[[f32; 3]], roughness: &[f32]) -> Vec<[f32; 3]> {
        let last = self.levels.len() - 1;
        let position: Vec<f32> =
            roughness.iter().map(|roughness| level_of_roughness(*roughness, &self.levels)).collect();
        let mut sums = vec![[0.0; 3]; directions.len()];
        for (number, (level, faces)) in self.levels.iter().zip(&self.faces).enumerate() {
            let weight = |position: f32| (1.0 - (position.clamp(0.0, last as f32) - number as f32).abs()).max(0.0);
            let seen: Vec<usize> = (0..directions.len()).filter(|index| weight(position[*index]) > 0.0).collect();
            let along: Vec<[f64; 3]> = seen.iter().map(|index| directions[*index].map(f64::from)).collect();
            for (index, light) in seen.iter().zip(radiance_along(faces, level.resolution, &along)) {
                (0..3).for_each(|k| sums[*index][k] += weight(position[*index]) * light[k]);
            }
        }
        sums
    }

    /// Irradiance / π along normals.
    pub(crate) fn irradiance_of(&self, normals: &[[f32; 3]]) -> Vec<[f32; 3]> {
        let (faces, resolution) = &self.irradiance;
        radiance_along(faces, *resolution, &normals.iter().map(|normal| normal.map(f64::from)).collect::<Vec<_>>())
    }
}

#[pymethods]
impl PrefilteredLight {
    /// Levels, sharpest first: roughness and faces.
    #[getter]
    fn levels<'py>(&self, py: Python<'py>) -> PyResult<Vec<(f32, Bound<'py, PyArrayDyn<f32>>)>> {
        let level = |(level, faces): (&Level, &Vec<f32>)| {
            Ok((level.roughness, array(py, faces.clone(), &[6, level.resolution, level.resolution, 3])?))
        };
        self.levels.iter().zip(&self.faces).map(level).collect()
    }

    /// Radiance along rows of directions, each at a roughness.
    fn _radiance<'py>(
        &self,
        py: Python<'py>,
        directions: &Bound<'py, PyAny>,
        roughness: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        let directions = directions_of(directions, "directions")?;
        let roughness = Floats::new(roughness, "roughness")?.finite("roughness")?;
        let (along, rough) = (directions.rows::<3>(), roughness.values());
        let light = compute(py, || self.radiance(along, rough))?;
        Ok(crate::arrays::rows(py, light, &[along.len(), 3])?)
    }

    /// Irradiance / π along rows of normals.
    fn _irradiance<'py>(&self, py: Python<'py>, normals: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        let normals = directions_of(normals, "normals")?;
        let along = normals.rows::<3>();
        let light = compute(py, || self.irradiance_of(along))?;
        Ok(crate::arrays::rows(py, light, &[along.len(), 3])?)
    }

    fn __repr__(&self) -> String {
        let roughness: Vec<String> = self.levels.iter().map(|level| format!("{:.3}", level.roughness)).collect();
        format!("PrefilteredLight({} levels of roughness {})", self.levels.len(), roughness.join(", "))
    }
}

/// Rows of directions, none of them zero.
pub(crate) fn directions_of<'py>(value: &Bound<'py, PyAny>, name: &str) -> Result<Floats<'py>> {
    let rows = Floats::new(value, name)?.shaped(name, "[N, 3]")?.finite(name)?;
    match rows.rows::<3>().iter().any(|row| *row == [0.0; 3]) {
        true => Err(Failure::input(format!("{name} holds a vector of length 0, which has no direction"))),
        false => Ok(rows),
    }
}

/// Filters a cube map of linear radiance into levels of roughness.
#[pyfunction]
#[pyo3(signature = (cube, scheme="exact"))]
pub(crate) fn prefilter(py: Python<'_>, cube: &Bound<'_, PyAny>, scheme: &str) -> PyResult<PrefilteredLight> {
    let (values, resolution) = cube_of(cube)?;
    let scheme = match scheme {
        "exact" => PrefilterScheme::Exact,
        "official" => PrefilterScheme::Official,
        _ => return Err(Failure::input(format!("{scheme:?} is no scheme; use exact or official")).into()),
    };
    if !scheme.takes(resolution) {
        let error = specula_cpu::CpuError::LightResolution { resolution, least: scheme.resolution_min() };
        return Err(Failure::input(error).into());
    }
    let environment = Environment { resolution, activation: RadianceActivation::Identity, values };
    let filtered = try_compute(py, || {
        let levels = Levels::new(scheme, resolution);
        let light = CpuExecutor::new().prefilter_into(&environment, scheme, levels)?;
        let levels = levels.as_slice().to_vec();
        let count = levels.len();
        // The lobe of roughness 1 is the cosine; the authors' code has a map of its own.
        let irradiance = match scheme {
            PrefilterScheme::Exact => (light.faces(count - 1), levels[count - 1].resolution),
            PrefilterScheme::Official => (light.faces(count), IRRADIANCE_RESOLUTION),
        };
        let faces = (0..count).map(|level| light.faces(level)).collect();
        Ok(PrefilteredLight { levels, faces, irradiance })
    });
    Ok(filtered?)
}
