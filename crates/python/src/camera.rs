//! Cameras, and pictures of data sets with theirs.

use crate::{
    arrays::{Floats, array},
    errors::{Failure, Result},
    threads::try_compute,
};
use glam::Vec3;
use half::f16;
use numpy::{PyArrayDyn, PyArrayMethods};
use pyo3::prelude::*;
use specula_core::camera;
use specula_io::dataset::LoadOptions;
use specula_scene::dataset::Dataset;
use std::path::PathBuf;

/// Largest side of a picture in pixels.
const SIDE_MAX: u32 = 1 << 16;

/// Pinhole camera of OpenCV's axes: x to the right, y down, z forward; pixel centres at + 0.5.
#[pyclass(frozen, module = "specula_gs", from_py_object)]
#[derive(Clone, Debug)]
pub(crate) struct Camera {
    /// Pose, intrinsics, near plane and size.
    pub(crate) camera: camera::Camera,
    /// Name in its data set.
    #[pyo3(get)]
    name: String,
}

impl Camera {
    /// Camera of a data set or a model.
    pub(crate) fn named((name, camera): (String, camera::Camera)) -> Self {
        Self { camera, name }
    }
}

#[pymethods]
impl Camera {
    #[new]
    #[pyo3(signature = (viewmat, K, width, height, *, near=0.01, name=""))]
    #[expect(non_snake_case, reason = "the name of intrinsics in the field")]
    fn new(
        viewmat: &Bound<'_, PyAny>,
        K: &Bound<'_, PyAny>,
        width: u32,
        height: u32,
        near: f32,
        name: &str,
    ) -> PyResult<Self> {
        check_frame([width, height], near)?;
        let view = Floats::new(viewmat, "viewmat")?.shaped("viewmat", "[4, 4]")?;
        let intrinsics = Floats::new(K, "K")?.shaped("K", "[3, 3]")?;
        let (view, intrinsics) = (view.rows::<4>().as_chunks().0, intrinsics.rows::<3>().as_chunks().0);
        let camera = camera::Camera::from_matrices(&view[0], &intrinsics[0], width, height);
        let camera = camera.map_err(Failure::input)?;
        Ok(Self { camera: camera::Camera { near, ..camera }, name: name.to_owned() })
    }

    /// Camera at `eye` that looks at `target`, with `up` upwards in the picture.
    #[staticmethod]
    #[pyo3(signature = (eye, target, up, fov_x, width, height, *, near=0.01, name=""))]
    fn look_at(
        eye: [f32; 3],
        target: [f32; 3],
        up: [f32; 3],
        fov_x: f32,
        width: u32,
        height: u32,
        near: f32,
        name: &str,
    ) -> PyResult<Self> {
        check_frame([width, height], near)?;
        let [from, to, above] = [eye, target, up].map(Vec3::from);
        let is_view = (to - from).cross(above).length() > 0.0 && (to - from).is_finite() && above.is_finite();
        if !is_view || !(fov_x > 0.0 && fov_x < core::f32::consts::PI) {
            return Err(Failure::input(format!(
                "no camera at {eye:?} looks at {target:?} with {up:?} upwards over {fov_x} radians; use two points, an up \
                 direction that is not along the view, and an angle between 0 and π"
            ))
            .into());
        }
        let camera = camera::Camera { near, ..camera::Camera::look_at(from, to, above, fov_x, width, height) };
        Ok(Self { camera, name: name.to_owned() })
    }

    /// Matrix from the world to the camera.
    #[getter]
    fn viewmat<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        let rotation = self.camera.camera_from_world;
        let shift = -(rotation * self.camera.position);
        let rows = [0, 1, 2].map(|row| {
            let [x, y, z] = rotation.row(row).to_array();
            [x, y, z, shift[row]]
        });
        Ok(array(py, [rows[0], rows[1], rows[2], [0.0, 0.0, 0.0, 1.0]].concat(), &[4, 4])?)
    }

    /// Intrinsics in pixels.
    #[getter]
    #[expect(non_snake_case, reason = "the name of intrinsics in the field")]
    fn K<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        let ([fx, fy], [cx, cy]) = (self.camera.focal_px, self.camera.principal_px);
        Ok(array(py, vec![fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0], &[3, 3])?)
    }

    /// Centre in the world.
    #[getter]
    fn position(&self) -> [f32; 3] {
        self.camera.position.to_array()
    }

    /// Pixels in a row.
    #[getter]
    fn width(&self) -> u32 {
        self.camera.width
    }

    /// Rows.
    #[getter]
    fn height(&self) -> u32 {
        self.camera.height
    }

    /// Depth from which on Gaussians are drawn.
    #[getter]
    fn near(&self) -> f32 {
        self.camera.near
    }

    /// The same view at another size.
    fn resized(&self, width: u32, height: u32) -> PyResult<Self> {
        check_frame([width, height], self.camera.near)?;
        Ok(Self { camera: self.camera.resized(width, height), name: self.name.clone() })
    }

    fn __repr__(&self) -> String {
        let camera::Camera { width, height, position, .. } = self.camera;
        format!("Camera({:?}, {width} × {height} px, at {:?})", self.name, position.to_array())
    }
}

fn check_frame([width, height]: [u32; 2], near: f32) -> Result<()> {
    if !(1..=SIDE_MAX).contains(&width) || !(1..=SIDE_MAX).contains(&height) {
        return Err(Failure::input(format!("{width} × {height} is no size; use 1 to {SIDE_MAX} pixels")));
    }
    if !(near >= 0.0 && near.is_finite()) {
        return Err(Failure::input(format!("near is {near}; use a depth of 0 or more")));
    }
    Ok(())
}

/// Picture of a data set with its camera.
#[pyclass(frozen, module = "specula_gs")]
#[derive(Debug)]
pub(crate) struct View {
    /// Camera of the picture.
    #[pyo3(get)]
    camera: Camera,
    /// Pixels in 8-bit sRGB with straight alpha.
    #[pyo3(get)]
    rgba: Py<PyArrayDyn<u8>>,
    /// Colours on the curve of sRGB without a limit at white, of a linear picture; none of others.
    #[pyo3(get)]
    unclipped: Option<Py<PyArrayDyn<f32>>>,
    /// Unit normals in the world, 0 where there is none; none without ground truth.
    #[pyo3(get)]
    normals: Option<Py<PyArrayDyn<f32>>>,
}

impl View {
    /// The picture and its camera.
    pub(crate) fn read(&self, py: Python<'_>) -> PyResult<specula_train::view::View> {
        let rgba = self.rgba.bind(py).to_vec()?;
        let unclipped = self.unclipped.as_ref().map(|colors| colors.bind(py).to_vec()).transpose()?;
        let halves = |color: &[f32; 3]| color.map(f16::from_f32);
        let unclipped = unclipped.map(|colors| colors.as_chunks().0.iter().map(halves).collect());
        let Camera { camera, name } = self.camera.clone();
        Ok(specula_train::view::View { name, camera, rgba, unclipped, normals: None })
    }
}

#[pymethods]
impl View {
    fn __repr__(&self) -> String {
        format!("View({})", self.camera.__repr__())
    }
}

/// Pictures of a data set and their cameras: those to train on, or those held out.
#[pyfunction]
#[pyo3(signature = (dataset, split="train", *, downscale=1))]
pub(crate) fn load_views(py: Python<'_>, dataset: PathBuf, split: &str, downscale: u32) -> PyResult<Vec<View>> {
    if !["train", "test"].contains(&split) {
        return Err(Failure::input(format!("{split:?} is no split; use train or test")).into());
    }
    let options = LoadOptions { with_test: true, downscale, ..LoadOptions::default() };
    let data = try_compute(py, || Ok(Dataset::load(&dataset, &options, |_, _| {})?))?;
    let views = if split == "test" { data.test } else { data.train };
    let view = |view: specula_train::view::View| -> PyResult<View> {
        let shape = [view.camera.height as usize, view.camera.width as usize];
        let normals = view.normals.map(|normals| {
            let known = |(normal, is_known): (&[f32; 3], &bool)| if *is_known { *normal } else { [0.0; 3] };
            normals.values.iter().zip(&normals.mask).map(known).collect::<Vec<_>>()
        });
        let unclipped = view.unclipped.map(|colors| colors.into_iter().map(|color| color.map(f32::from)).collect());
        let planes = |rows: Vec<[f32; 3]>| crate::arrays::rows(py, rows, &[shape[0], shape[1], 3]);
        let (normals, unclipped) = (normals.map(planes).transpose()?, unclipped.map(planes).transpose()?);
        Ok(View {
            camera: Camera { camera: view.camera, name: view.name },
            rgba: array(py, view.rgba, &[shape[0], shape[1], 4])?.unbind(),
            unclipped: unclipped.map(Bound::unbind),
            normals: normals.map(Bound::unbind),
        })
    };
    views.into_iter().map(view).collect()
}
