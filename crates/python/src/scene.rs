//! Scenes of trained models: read, rendered, relit, written.

use crate::{
    arrays::{array, interleaved},
    camera::{Camera, View},
    errors::{Failure, Result},
    light::{Light, parsed},
    threads::{try_compute, try_compute_with},
};
use pyo3::{exceptions::PyKeyboardInterrupt, prelude::*, types::PyDict};
use specula_core::{
    activation::sigmoid,
    rules::RenderRules,
    scene::{Image, LOG_SCALE, MEAN, OPACITY, QUAT},
};
use specula_cpu::CpuExecutor;
use specula_io::origin;
use specula_scene::{
    ExecutorChoice, Layer, Lighting, OpenedModel, RenderOptions, SceneRenderer, Shading,
    export::{BakeMethod, GaussianFormat, PlainGaussians, is_of_model, visible},
    lamps::shadow_surface,
    light_file,
    light_fit::LightFit,
    orientation,
    upright::Upright,
};
use specula_train::evaluate::over_background;
use std::{collections::BTreeMap, path::PathBuf, sync::Mutex};

/// Cameras around a scene from which colours are baked.
const BAKED_VIEWS: u32 = 100;

/// Scene of a model.
#[pyclass(frozen, module = "specula_gs")]
#[derive(Debug)]
pub(crate) struct Scene {
    opened: Mutex<OpenedModel>,
}

impl Scene {
    pub(crate) fn new(opened: OpenedModel) -> Self {
        Self { opened: Mutex::new(opened) }
    }

    /// The model, when no other thread works with it.
    fn with<T: Send>(&self, py: Python<'_>, work: impl FnOnce(&mut OpenedModel) -> Result<T> + Send) -> Result<T> {
        try_compute_with(py, &self.opened, work)
    }
}

#[pymethods]
impl Scene {
    /// Scene of a model's folder, or of a PLY or glTF file.
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        Ok(Self::new(try_compute(py, || Ok(OpenedModel::open(&path)?))?))
    }

    /// Writes the scene into the folder of a model.
    #[pyo3(signature = (folder, *, iteration=None))]
    fn save(&self, py: Python<'_>, folder: PathBuf, iteration: Option<u32>) -> PyResult<()> {
        Ok(self.with(py, |opened| {
            let iteration = iteration.or(opened.iteration).unwrap_or(0);
            let info = opened.info.clone().unwrap_or_default();
            std::fs::create_dir_all(&folder)
                .map_err(|cause| Failure::Named("FileError", format!("{folder:?} cannot be made: {cause}")))?;
            Ok(opened.scene.save(&folder, iteration, &info)?)
        })?)
    }

    /// Number of Gaussians.
    fn __len__(&self, py: Python<'_>) -> PyResult<usize> {
        Ok(self.with(py, |opened| Ok(opened.scene.gaussians.count))?)
    }

    /// Whether colours depend on a light.
    #[getter]
    fn is_shaded(&self, py: Python<'_>) -> PyResult<bool> {
        Ok(self.with(py, |opened| Ok(opened.scene.gaussians.layout.is_shaded()))?)
    }

    /// Whether the scene has physical materials.
    #[getter]
    fn has_materials(&self, py: Python<'_>) -> PyResult<bool> {
        Ok(self.with(py, |opened| Ok(opened.scene.gaussians.layout.is_physical))?)
    }

    /// Background of the training in sRGB.
    #[getter]
    fn background(&self, py: Python<'_>) -> PyResult<[f32; 3]> {
        Ok(self.with(py, |opened| Ok(opened.background()))?)
    }

    /// Unit up direction.
    #[getter]
    fn up(&self, py: Python<'_>) -> PyResult<[f32; 3]> {
        Ok(self.with(py, |opened| Ok(orientation::up(&opened.orientation(None)?).to_array()))?)
    }

    /// Notes on parts of the files that are not taken as they are.
    #[getter]
    fn notes(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        Ok(self.with(py, |opened| Ok(opened.notes.clone()))?)
    }

    /// Cameras that the model records.
    #[pyo3(signature = (split="all"))]
    fn cameras(&self, py: Python<'_>, split: &str) -> PyResult<Vec<Camera>> {
        let cameras = self.with(py, |opened| match split {
            "all" => Ok(opened.cameras()?),
            "train" => Ok(opened.training_cameras()?),
            "test" => Ok(opened.test_cameras()?),
            _ => Err(Failure::input(format!("{split:?} is no split; use all, train or test"))),
        })?;
        Ok(cameras.into_iter().map(Camera::named).collect())
    }

    /// Picture of a camera, layer by layer.
    #[pyo3(signature = (camera, layers=vec!["rgb".to_owned()], *, background=None, executor="auto"))]
    fn render<'py>(
        &self,
        py: Python<'py>,
        camera: &Camera,
        layers: Vec<String>,
        background: Option<[f32; 3]>,
        executor: &str,
    ) -> PyResult<Bound<'py, PyDict>> {
        self.renderer(py, layers, executor)?.render(py, camera, background)
    }

    /// Renderer of many pictures.
    #[pyo3(signature = (layers=vec!["rgb".to_owned()], *, executor="auto"))]
    fn renderer(&self, py: Python<'_>, layers: Vec<String>, executor: &str) -> PyResult<Renderer> {
        let layers: Vec<Layer> =
            layers.into_iter().map(|layer| parsed(layer, |text| text.parse::<Layer>())).collect::<Result<_>>()?;
        let executor = executor_of(executor)?;
        Ok(self.with(py, |opened| {
            let layers = Layer::expanded(&layers);
            let scene = opened.scene.clone();
            let (layout, form) = (scene.gaussians.layout, scene.shading_model.shading.form);
            if let Some(layer) = layers.iter().find(|layer| !layer.exists(layout, form)) {
                return Err(Failure::input(format!("the scene has no layer {}", layer.name())));
            }
            let options = RenderOptions::full_precision(executor);
            let renderer = SceneRenderer::new(scene, Layer::channels(&layers), &options)?;
            Ok(Renderer { renderer: Mutex::new(renderer), layers, background: opened.background() })
        })?)
    }

    /// Puts the scene under another light.
    #[pyo3(signature = (light, *, shadows=true))]
    fn relight(&self, py: Python<'_>, light: &Light, shadows: bool) -> PyResult<()> {
        Ok(self.with(py, |opened| {
            let up = orientation::up(&opened.orientation(None)?);
            let options = RenderOptions::full_precision(ExecutorChoice::Cpu);
            opened.fuse_near_field(&options, |_, _| {})?;
            let occluder = match light.lighting.has_lamps() && shadows {
                true => shadow_surface(opened, &options, |_, _| ())?,
                false => None,
            };
            Ok(Lighting { occluder, ..light.lighting.clone() }.light(&mut opened.scene, up)?)
        })?)
    }

    /// Light of pictures of the scene.
    #[pyo3(signature = (views, *, iterations=900, background=None, executor="auto"))]
    fn fit_light(
        &self,
        py: Python<'_>,
        views: Vec<PyRef<'_, View>>,
        iterations: u32,
        background: Option<[f32; 3]>,
        executor: &str,
    ) -> PyResult<Light> {
        let pictures = views.iter().map(|view| view.read(py)).collect::<PyResult<Vec<_>>>()?;
        let executor = executor_of(executor)?;
        let is_interrupted = || Python::attach(|py| py.check_signals()).is_err();
        let found = self.with(py, |opened| {
            let background = background.unwrap_or(opened.background());
            opened.fuse_near_field(&RenderOptions::full_precision(executor.clone()), |_, _| {})?;
            let fit = LightFit { pictures: &pictures, background, iterations, executor };
            let light = opened.scene.fit_light(&fit, |_, _| !is_interrupted())?;
            let up = orientation::up(&opened.orientation(None)?);
            Ok(light.map(|light| light_file::map_of(&light, up)))
        })?;
        match found {
            Some(map) => Ok(Light { lighting: Lighting { map: Some(map), ..Lighting::default() } }),
            None => Err(PyKeyboardInterrupt::new_err("interrupted")),
        }
    }

    /// Shows view-dependent colours or physical materials.
    fn shade_as(&self, py: Python<'_>, shading: &str) -> PyResult<()> {
        let shading = match shading {
            "view" => Shading::View,
            "physical" => Shading::Physical,
            _ => return Err(Failure::input(format!("{shading:?} is no shading; use view or physical")).into()),
        };
        Ok(self.with(py, |opened| {
            opened.scene = opened.scene.clone().shaded(shading)?;
            Ok(())
        })?)
    }

    /// Writes plain Gaussians for other programs.
    #[pyo3(signature = (path, *, sh_degree=3, min_opacity=0.0, upright=false))]
    fn export(&self, py: Python<'_>, path: PathBuf, sh_degree: u8, min_opacity: f32, upright: bool) -> PyResult<()> {
        let ending = path.extension().map(|ending| ending.to_string_lossy().to_lowercase()).unwrap_or_default();
        let format = GaussianFormat::from_extension(&ending).ok_or_else(|| {
            Failure::input(format!("{path:?} has no known ending; use .ply, .splat, .spz, .glb, .usda or .usdz"))
        })?;
        Ok(self.with(py, |opened| {
            if opened.folder.as_deref().is_some_and(|folder| is_of_model(&path, folder, Some(folder))) {
                return Err(Failure::input(format!("{path:?} is a file of the model itself; name another")));
            }
            let plain = baked(opened, sh_degree.min(format.degree_max()), min_opacity)?;
            let first = opened.cameras()?.first().map(|(_, camera)| *camera);
            let orientation = opened.orientation(None)?;
            let placement = match (upright, format.has_node()) {
                (true, _) => Some(Upright::new(&orientation, first.as_ref(), format.axes())),
                (false, true) => Some(Upright::turned(&orientation, format.axes())),
                (false, false) => None,
            };
            let is_commented = !upright || format.has_node();
            let provenance = is_commented.then(|| PlainGaussians::provenance(&opened.scene, BakeMethod::Harmonics));
            let origin = origin::comment(opened.origin).filter(|_| !upright);
            let comments: Vec<String> = provenance.into_iter().chain(origin).collect();
            plain.write(&path, format, &opened.scene, placement.as_ref(), &comments)?;
            Ok(())
        })?)
    }

    /// Plain Gaussians as arrays.
    #[pyo3(signature = (*, sh_degree=3))]
    fn gaussians<'py>(&self, py: Python<'py>, sh_degree: u8) -> PyResult<Bound<'py, PyDict>> {
        let (arrays, sh_degree) = self.with(py, |opened| {
            let gaussians = baked(opened, sh_degree, 0.0)?.gaussians;
            let (count, layout) = (gaussians.count, gaussians.layout);
            let all = |first: usize, len: usize, of: fn(f32) -> f32| -> Vec<f32> {
                let planes: Vec<Vec<f32>> =
                    (first..first + len).map(|plane| gaussians.plane(plane).collect()).collect();
                interleaved(&planes.iter().map(|plane| &plane[..count]).collect::<Vec<_>>())
                    .into_iter()
                    .map(of)
                    .collect()
            };
            let keep = |number: f32| number;
            let columns = BTreeMap::from([
                ("means", (all(MEAN, 3, keep), vec![count, 3])),
                ("quats", (all(QUAT, 4, keep), vec![count, 4])),
                ("scales", (all(LOG_SCALE, 3, f32::exp), vec![count, 3])),
                ("opacities", (all(OPACITY, 1, sigmoid), vec![count])),
                ("colors", (all(layout.sh_start(), 3 * layout.sh_count(), keep), vec![count, layout.sh_count(), 3])),
            ]);
            Ok((columns, layout.sh_degree))
        })?;
        let columns = PyDict::new(py);
        for (name, (values, shape)) in arrays {
            columns.set_item(name, array(py, values, &shape)?)?;
        }
        columns.set_item("sh_degree", sh_degree)?;
        Ok(columns)
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        Ok(self.with(py, |opened| {
            let layout = opened.scene.gaussians.layout;
            let kind = match (layout.is_shaded(), layout.is_physical) {
                (_, true) => "with materials",
                (true, false) => "shaded",
                (false, false) => "plain",
            };
            Ok(format!("Scene({} Gaussians, {kind})", opened.scene.gaussians.count))
        })?)
    }
}

/// Executor of a name.
pub(crate) fn executor_of(name: &str) -> Result<ExecutorChoice> {
    parsed(name.to_owned(), |text| text.parse())
}

/// Visible Gaussians of a scene without shading, their colours baked where it has any.
fn baked(opened: &OpenedModel, degree: u8, min_opacity: f32) -> Result<PlainGaussians> {
    if degree > 3 {
        return Err(Failure::input(format!("sh_degree is {degree}; use 0 to 3")));
    }
    let scene = &opened.scene;
    let kept = visible(&scene.gaussians, min_opacity);
    if kept.is_empty() {
        return Err(Failure::input(format!("no Gaussian is finite and has an opacity of {min_opacity} or more")));
    }
    let cameras =
        if scene.gaussians.layout.is_shaded() { opened.surrounding_cameras(BAKED_VIEWS)? } else { Vec::new() };
    let bake =
        PlainGaussians::bake(CpuExecutor::new(), scene, kept, &cameras, degree, BakeMethod::Harmonics, |_, _| ());
    Ok(bake?)
}

/// Scene on an executor, its light filtered, for many pictures.
#[pyclass(frozen, module = "specula_gs")]
#[derive(Debug)]
pub(crate) struct Renderer {
    renderer: Mutex<SceneRenderer>,
    layers: Vec<Layer>,
    background: [f32; 3],
}

/// Channels of a picture, pixel by pixel, and their number.
type Pixels = (Vec<f32>, usize);

#[pymethods]
impl Renderer {
    /// Picture of a camera, layer by layer.
    #[pyo3(signature = (camera, *, background=None))]
    fn render<'py>(
        &self,
        py: Python<'py>,
        camera: &Camera,
        background: Option<[f32; 3]>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let (camera, background) = (camera.camera, background.unwrap_or(self.background));
        let pictures = try_compute_with(py, &self.renderer, |renderer| {
            let rules = *renderer.rules();
            let mut last: Option<(RenderRules, Image<Vec<f32>>)> = None;
            let mut pictures: Vec<(&'static str, Pixels)> = Vec::new();
            for layer in &self.layers {
                let rules = RenderRules { light_layer: layer.light_layer(), ..rules };
                let image = match last.take() {
                    Some((known, image)) if known == rules => image,
                    _ => renderer.render_lit(camera.light as usize, &camera, &rules)?,
                };
                pictures.push((layer.name(), pixels_of(*layer, &image, background)));
                last = Some((rules, image));
            }
            Ok(pictures)
        })?;
        let layers = PyDict::new(py);
        let size = [camera.height as usize, camera.width as usize];
        for (name, (values, channels)) in pictures {
            let shape = [size[0], size[1], channels];
            layers.set_item(name, array(py, values, if channels == 1 { &shape[..2] } else { &shape })?)?;
        }
        Ok(layers)
    }

    /// Layers of each picture.
    #[getter]
    fn layers(&self) -> Vec<&'static str> {
        self.layers.iter().map(|layer| layer.name()).collect()
    }
}

/// Numbers of a layer: colours over the background in sRGB, and others as [`Layer::planes`] has
/// them.
fn pixels_of(layer: Layer, image: &Image<Vec<f32>>, background: [f32; 3]) -> Pixels {
    let planes = match layer {
        Layer::Rgb | Layer::All => over_background(image, background),
        other => other.planes(image).into_iter().flat_map(|(_, plane)| plane).collect(),
    };
    let planes: Vec<&[f32]> = planes.chunks(image.pixel_count().max(1)).collect();
    (interleaved(&planes), planes.len())
}
