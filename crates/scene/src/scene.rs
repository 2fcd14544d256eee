//! Gaussians, their light and their shading model.

use crate::{
    SceneError, Shading, ShadingModel,
    environment::{fitting, levels_of},
    lamps::{SceneLamps, shine_on},
    plain::subset,
};
use specula_core::{
    activation::{logit, sigmoid},
    cull::{CullReason, CullStats},
    near_field::{NearField, VERTEX_ALBEDO},
    pack::Storage,
    plan::{Needs, Plan},
    prefilter::Levels,
    rules::{Channels, RenderRules},
    scene::{ALBEDO, Environment, Gaussians, MEAN, RadianceActivation},
};
use specula_io::{
    Result,
    latlong::{self, LatLong, MapOrientation, UpAxis},
    model_folder::{self, ModelInfo, Snapshot},
    origin,
};
use specula_mesh::{ambient::Ambient, near_field, sky::Sky, surface::Surface};
use specula_train::{near_field::set_ambient, trainer::HostScene};
use std::{path::Path, sync::Arc};

/// Minimum and default resolution of a light that replaces a scene's, in texels along a face's
/// edge.
const LIGHT_RESOLUTION: [usize; 2] = [64, 128];

/// Gaussians, their light, and the shading model that turns their attributes into colours.
#[derive(Clone, Debug)]
pub struct Scene {
    /// Gaussians in the conventions of the shading model, not those of files.
    pub gaussians: Gaussians<Vec<f32>>,
    /// Distant light; `None` for plain Gaussian splatting.
    pub light: Option<Environment<Vec<f32>>>,
    /// Lights of groups of pictures other than the first, by [`Camera::light`] − 1; none unless it
    /// was trained under several.
    ///
    /// [`Camera::light`]: specula_core::camera::Camera::light
    pub other_lights: Vec<Environment<Vec<f32>>>,
    /// Surface of the scene that reflected rays may hit; `None` if they see only the distant light.
    pub near_field: Option<Arc<Surface>>,
    /// Lamps in addition to the distant light; `None` unless added.
    pub lamps: Option<SceneLamps>,
    /// Rules that the attributes were trained under.
    pub shading_model: ShadingModel,
}

impl Scene {
    /// Result of a training.
    pub(crate) fn of_training(host: HostScene, shading_model: ShadingModel) -> Self {
        let HostScene { gaussians, environment: light, other_lights, near_field } = host;
        Self { gaussians, light, other_lights, near_field: near_field.map(Surface::shared), lamps: None, shading_model }
    }

    /// Gaussians without a light, a surface and lamps.
    pub const fn unlit(gaussians: Gaussians<Vec<f32>>, shading_model: ShadingModel) -> Self {
        Self { gaussians, light: None, other_lights: Vec::new(), near_field: None, lamps: None, shading_model }
    }

    /// Surface that reflected rays may hit, as a near field.
    pub fn near_field(&self) -> Option<&NearField<Vec<f32>>> {
        self.near_field.as_ref().map(|surface| &***surface)
    }

    /// Light at a resolution that the prefilter supports, if pictures under these rules look it up.
    pub fn light_for(&self, rules: &RenderRules) -> Option<Environment<Vec<f32>>> {
        let light = self.light.as_ref().filter(|_| rules.is_lit && self.gaussians.layout.is_shaded())?;
        Some(fitting(light, rules.scheme))
    }

    /// The other lights as [`Scene::light_for`].
    pub fn other_lights_for(&self, rules: &RenderRules) -> Vec<Environment<Vec<f32>>> {
        let is_lit = rules.is_lit && self.gaussians.layout.is_shaded() && self.light.is_some();
        self.other_lights.iter().filter(|_| is_lit).map(|light| fitting(light, rules.scheme)).collect()
    }

    /// Keeps one of its lights, by the number of [`Camera::light`]; the first for one that it does
    /// not have.
    ///
    /// [`Camera::light`]: specula_core::camera::Camera::light
    pub(crate) fn select_light(&mut self, number: usize) {
        let others = core::mem::take(&mut self.other_lights);
        if let Some(light) = number.checked_sub(1).and_then(|index| others.into_iter().nth(index)) {
            self.light = Some(light);
        }
    }

    /// Rules of pictures with these channels, with and without the stages that the scene needs.
    pub fn plan(&self, channels: Channels) -> Plan {
        self.plan_for(&self.needs(), channels)
    }

    /// Terms that Gaussians and light need; reads all numbers of both.
    pub(crate) fn needs(&self) -> Needs {
        Needs::of(&self.gaussians).under(self.light.iter().chain(&self.other_lights))
    }

    /// [`Scene::plan`] for known needs.
    pub(crate) fn plan_for(&self, needs: &Needs, channels: Channels) -> Plan {
        let plan = self.shading_model.plan(self.gaussians.layout, needs, self.levels().as_ref(), channels);
        plan.tracing(self.near_field.is_some() && self.shading_model.traces_near()).illuminated(self.lamps.is_some())
    }

    /// Gaussians rounded to their storage, so that a plan sees the rendered numbers.
    #[must_use]
    pub fn rounded(mut self, storage: Storage) -> Self {
        storage.round(&mut self.gaussians);
        self
    }

    /// The same scene with some of its Gaussians.
    #[must_use]
    pub fn kept(&self, kept: &[usize]) -> Self {
        Self { gaussians: subset(&self.gaussians, kept, self.gaussians.layout), ..self.clone() }
    }

    /// The part of the scene in a region: Gaussians with their means in it, and triangles of the
    /// surface with their corners in it. Light that the rest occluded reaches physical materials.
    #[must_use]
    pub fn cropped(&self, contains: impl Fn([f32; 3]) -> bool) -> Self {
        let is_inside = |index: &usize| contains(self.gaussians.get::<3>(*index, MEAN));
        let kept: Vec<usize> = (0..self.gaussians.count).filter(is_inside).collect();
        let mut cropped = self.kept(&kept);
        if let Some(surface) = &self.near_field {
            cropped.near_field = near_field::within(surface, contains).map(Surface::shared);
            let sky = self.light.as_ref().filter(|_| self.gaussians.layout.is_physical).map(Sky::new);
            let surface = cropped.near_field.as_deref().zip(sky);
            let ambient = surface.map(|(surface, sky)| (surface, Ambient::new(surface, &sky)));
            set_ambient(&mut cropped.gaussians, ambient.as_ref().map(|(surface, ambient)| (&***surface, ambient)));
        }
        cropped
    }

    /// Levels of the filtered light; `None` without a light or lookups.
    pub fn levels(&self) -> Option<Levels> {
        let light = self.light.as_ref().filter(|_| self.gaussians.layout.is_shaded())?;
        Some(levels_of(light, self.shading_model.scheme))
    }

    /// Replaces the light by a lat-long map of radiance with its poles along `up` in the scene's
    /// world. The cube has the resolution of the previous light, at least 64; 128 if there was
    /// none.
    ///
    /// Physical materials replace view-dependent colours if there are any, and their light,
    /// occluded by the scene's surface, is computed again.
    pub fn relight(&mut self, map: &LatLong, up: impl Into<MapOrientation>) {
        let resolution = self.resolution_of_others();
        let values = latlong::to_cube(map, resolution, up);
        self.put_under(Environment { resolution, activation: RadianceActivation::Identity, values });
    }

    /// Replaces all lights by another one.
    pub(crate) fn put_under(&mut self, light: Environment<Vec<f32>>) {
        self.light = Some(light);
        self.other_lights.clear();
        if self.gaussians.layout.is_physical {
            self.shading_model = self.shading_model.shaded(Shading::Physical);
            self.transfer_light();
        }
    }

    /// Computes the light of physical materials, occluded by the surface of the scene, and the
    /// light that this surface reflects once.
    fn transfer_light(&mut self) {
        let (Some(light), Some(near_field)) = (&self.light, &self.near_field) else { return };
        let sky = Sky::new(light);
        let in_the_open = near_field.recolored(|surface| near_field::relight(surface, &sky));
        let ambient = Ambient::new(&in_the_open, &sky);
        set_ambient(&mut self.gaussians, Some((&in_the_open, &ambient)));
        self.near_field = Some(Arc::new(in_the_open.recolored(|surface| {
            near_field::transfer(surface, &ambient);
            if let Some(lamps) = &self.lamps {
                shine_on(surface, lamps);
            }
        })));
    }

    /// The same scene with its view-dependent colours or its physical materials.
    ///
    /// # Errors
    ///
    /// [`SceneError::NoMaterials`], if it was trained without materials.
    pub fn shaded(mut self, shading: Shading) -> core::result::Result<Self, SceneError> {
        if shading == Shading::Physical && !self.gaussians.layout.is_physical {
            return Err(SceneError::NoMaterials);
        }
        self.shading_model = self.shading_model.shaded(shading);
        Ok(self)
    }

    /// Multiplies the albedo of physical materials by a factor for linear red, green and blue, up
    /// to an albedo of 1, including that of the scene's surface. A scene without materials is
    /// unchanged.
    pub fn scale_albedo(&mut self, factors: [f32; 3]) {
        let Some(first) = self.gaussians.layout.physical_planes().map(|first| first + ALBEDO) else { return };
        let scaled = |albedo: [f32; 3]| core::array::from_fn(|k| (albedo[k] * factors[k]).clamp(0.0, 1.0));
        for index in 0..self.gaussians.count {
            let albedo: [f32; 3] = scaled(self.gaussians.get::<3>(index, first).map(sigmoid));
            self.gaussians.set(index, first, albedo.map(logit));
        }
        let Some(surface) = &mut self.near_field else { return };
        *surface = Arc::new(surface.recolored(|surface| {
            for numbers in surface.vertices_mut() {
                let albedo = &mut numbers[VERTEX_ALBEDO..VERTEX_ALBEDO + 3];
                albedo
                    .iter_mut()
                    .zip(factors)
                    .for_each(|(albedo, factor)| *albedo = (*albedo * factor).clamp(0.0, 1.0));
            }
        }));
    }

    /// Adds lamps to the light of a scene of physical materials, or to no light, replacing earlier
    /// lamps.
    ///
    /// # Errors
    ///
    /// [`SceneError::NoMaterials`], if it was trained without physical materials.
    pub fn add_lamps(&mut self, lamps: SceneLamps) -> core::result::Result<(), SceneError> {
        if !self.gaussians.layout.is_physical {
            return Err(SceneError::NoMaterials);
        }
        self.shading_model = self.shading_model.shaded(Shading::Physical);
        self.lamps = Some(lamps);
        Ok(())
    }

    /// Replaces the light by black.
    pub fn darken(&mut self) {
        self.relight(&LatLong { width: 2, height: 1, rgb: vec![0.0; 6] }, UpAxis::Z);
    }

    /// Resolution of lights that replace that of the scene, in texels along a face's edge.
    pub fn resolution_of_others(&self) -> usize {
        let [min, default] = LIGHT_RESOLUTION;
        self.light.as_ref().map_or(default, |light| light.resolution.max(min))
    }

    /// Number of Gaussians with numbers that are not finite, by reason, as text; `None` if all are
    /// finite.
    pub fn nonfinite_reasons(&self) -> Option<String> {
        let stats = CullStats::of(&self.gaussians, None);
        let reasons = CullReason::ALL.into_iter().filter(|reason| reason.is_nonfinite() && stats.count(*reason) > 0);
        let reasons: Vec<String> =
            reasons.map(|reason| format!("{} by {}", stats.count(reason), reason.words())).collect();
        (!reasons.is_empty()).then(|| reasons.join(", "))
    }

    /// True if the scene can be rendered: it has no Gaussians or a finite one, and a finite light.
    pub fn is_finite(&self) -> bool {
        let stats = CullStats::of(&self.gaussians, None);
        let broken: usize =
            CullReason::ALL.into_iter().filter(|reason| reason.is_nonfinite()).map(|reason| stats.count(reason)).sum();
        let mut lights = self.light.iter().chain(&self.other_lights);
        let is_lit = lights.all(|light| light.values.iter().all(|number| number.is_finite()));
        is_lit && (self.gaussians.count == 0 || broken < self.gaussians.count)
    }

    /// Writes the scene into the folder of a model as its newest iteration.
    ///
    /// # Errors
    ///
    /// A file that cannot be written.
    pub fn save(&self, folder: &Path, iteration: u32, info: &ModelInfo) -> Result<()> {
        let mut gaussians = self.gaussians.clone();
        self.shading_model.encode(&mut gaussians);
        let shading = gaussians.layout.is_shaded().then(|| self.shading_model.comment());
        let comments: Vec<String> = shading.into_iter().chain(origin::comment(info.origin)).collect();
        let snapshot = Snapshot {
            gaussians: &gaussians,
            comments: &comments,
            light: self.light.as_ref(),
            other_lights: &self.other_lights,
            near_field: self.near_field(),
            info,
        };
        model_folder::save(folder, iteration, &snapshot)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use specula_core::region::Ball;
    use specula_core::{
        cubemap::FACE_COUNT,
        near_field::VERTEX_LEN,
        scene::{AMBIENT, Layout, METALNESS, len_of_values},
        vector::vec3,
    };
    use specula_mesh::{Mesh, near_field::SurfaceMeans};

    /// Largest error of an albedo that went through its logit.
    const ROUNDING: f32 = 1e-6;

    /// Floor that sees a roof, and a Gaussian on each: without the roof light from all around
    /// reaches the floor.
    #[test]
    fn light_reaches_materials_where_its_occluders_are_cropped() {
        let layout = Layout::shaded(None).physical();
        let ambient = layout.physical_planes().unwrap() + AMBIENT;
        let mut gaussians = Gaussians { count: 2, layout, values: vec![0.0; len_of_values(2, layout)] };
        for (index, height) in [0.0, 1.0].into_iter().enumerate() {
            gaussians.set(index, MEAN, [0.0, 0.0, height]);
            gaussians.set(index, ambient, [0.25; 3]);
        }
        let square = |height: f32| [[-0.5, -0.5, height], [0.5, -0.5, height], [0.5, 0.5, height], [-0.5, 0.5, height]];
        let mesh = Mesh {
            positions: [square(0.0), square(1.0)].concat(),
            normals: [[[0.0, 0.0, 1.0]; 4], [[0.0, 0.0, -1.0]; 4]].concat(),
            colors: vec![[0.0; 3]; 8],
            triangles: vec![[0, 1, 2], [0, 2, 3], [4, 6, 5], [4, 7, 6]],
        };
        let near_field = SurfaceMeans::new(mesh, 1e-3).near_field().map(Surface::shared);
        let values = vec![1.0; 3 * FACE_COUNT * 16 * 16];
        let light = Some(Environment { resolution: 16, activation: RadianceActivation::Identity, values });
        let scene = Scene {
            gaussians,
            light,
            other_lights: Vec::new(),
            near_field,
            lamps: None,
            shading_model: ShadingModel::DEFERRED,
        };

        let around = |radius: f32| move |point: [f32; 3]| Ball { center: [0.0; 3], radius }.contains(point);
        let floor = scene.cropped(around(0.8));
        assert_eq!((floor.gaussians.count, floor.gaussians.get::<3>(0, ambient)), (1, [1.0; 3]));
        let surface = floor.near_field().expect("the floor is left");
        assert_eq!((surface.triangle_count, surface.vertex_count, surface.check()), (2, 4, Ok(())));
        assert!(surface.first_hit(vec3(0.1, 0.2, 0.5), vec3(0.0, 0.0, -1.0)).is_some());

        let both = scene.cropped(around(8.0));
        assert_eq!(both.near_field().map(|surface| surface.triangle_count), Some(4));
        assert!((0.7..0.95).contains(&both.gaussians.get::<1>(0, ambient)[0]), "the roof still shades the floor");

        let middle = scene.cropped(around(0.1));
        assert!(middle.near_field.is_none() && middle.gaussians.get::<3>(0, ambient) == [1.0; 3]);
    }

    #[test]
    fn only_albedos_are_scaled_up_to_one() {
        let layout = Layout::shaded(None).physical();
        let first = layout.physical_planes().unwrap();
        let mut gaussians = Gaussians { count: 2, layout, values: vec![0.0; len_of_values(2, layout)] };
        gaussians.set(0, first + ALBEDO, [0.2, 0.5, 0.9].map(logit));
        gaussians.set(0, first + METALNESS, [logit(0.25)]);
        let vertex: [f32; VERTEX_LEN] = core::array::from_fn(|number| 0.05 * number as f32);
        let near_field =
            NearField { node_count: 0, triangle_count: 0, vertex_count: 1, offset: 0.0, values: vertex.to_vec() };
        let mut scene = Scene {
            gaussians,
            light: None,
            other_lights: Vec::new(),
            near_field: Some(Surface::shared(near_field)),
            lamps: None,
            shading_model: ShadingModel::DEFERRED,
        };
        let before = scene.clone();
        scene.scale_albedo([2.0, 0.5, 1.5]);
        let albedo = |index: usize| scene.gaussians.get::<3>(index, first + ALBEDO).map(sigmoid::<f32>);
        for (found, expected) in albedo(0).into_iter().chain(albedo(1)).zip([0.4, 0.25, 1.0, 1.0, 0.25, 0.75]) {
            assert!((found - expected).abs() < ROUNDING, "{found} is not {expected}");
        }
        let metalness = |scene: &Scene| scene.gaussians.get::<1>(0, first + METALNESS);
        assert_eq!(metalness(&scene), metalness(&before));
        let numbers = scene.near_field.unwrap().values.clone();
        assert_eq!(numbers[..VERTEX_ALBEDO], vertex[..VERTEX_ALBEDO]);
        for (found, expected) in numbers[VERTEX_ALBEDO..].iter().zip([1.0, 0.35, 1.0]) {
            assert!((found - expected).abs() < ROUNDING, "{found} is not {expected}");
        }
        let mut plain = Scene { gaussians: Gaussians { layout: Layout::shaded(None), ..before.gaussians }, ..before };
        let values = plain.gaussians.values.clone();
        plain.scale_albedo([2.0; 3]);
        assert_eq!(plain.gaussians.values, values, "without materials there is no albedo");
    }
}
