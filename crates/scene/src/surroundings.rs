//! Near field of physical materials whose file has none, such as a relightable PLY: parts of the
//! scene occlude each other's light and reflect each other, as in a trained model.

use crate::{OpenedModel, RenderOptions, SceneError, SceneRenderer, Shading, lamps::VOXELS};
use specula_core::{
    camera::Camera,
    rules::{Channels, RenderRules},
    scene::{Environment, RadianceActivation},
};
use specula_mesh::{sky::Sky, surface::Surface};
use specula_train::near_field::{UnderSky, UnlitPicture, VIEWS_MAX, fused};

/// Longest edge of a fused view, in pixels.
const EDGE_MAX: u32 = 400;
/// Rendered pictures of a view: depths, and layers.
const PICTURES: usize = 2;

impl OpenedModel {
    /// Whether the scene has physical materials that come without a surface. A model's folder
    /// omits the surface only where parts of the scene do not see each other.
    pub fn lacks_surface(&self) -> bool {
        let scene = &self.scene;
        self.info.is_none()
            && scene.gaussians.layout.is_physical
            && scene.near_field.is_none()
            && scene.gaussians.count > 0
    }

    /// Fuses the near field of a scene that [lacks it](OpenedModel::lacks_surface) from pictures of
    /// its cameras, or of cameras around it. Nothing changes for other scenes, and for those whose
    /// parts do not see each other. Call it before the scene is lit.
    /// `progress` receives the number of rendered pictures and of all.
    ///
    /// # Errors
    ///
    /// Those of [`SceneRenderer::render`], or a `cameras.json` that cannot be read.
    pub fn fuse_near_field(
        &mut self,
        options: &RenderOptions,
        mut progress: impl FnMut(usize, usize),
    ) -> Result<(), SceneError> {
        if !self.lacks_surface() {
            return Ok(());
        }
        let cameras = self.surrounding_cameras(VIEWS_MAX as u32)?;
        let cameras: Vec<Camera> = cameras.iter().map(|camera| camera.limited(EDGE_MAX)).collect();
        let all = PICTURES * cameras.len().min(VIEWS_MAX);
        let materials = self.scene.clone().shaded(Shading::Physical)?;
        let mut renderer = SceneRenderer::without_light(materials, Channels::Layers, options)?;
        let rules = RenderRules { is_lit: false, traces_near: false, illuminates: false, ..*renderer.rules() };
        let (mut done, mut layers) = (0, None);
        let mut render = |camera: &Camera, picture: UnlitPicture| -> Result<_, SceneError> {
            let channels = match (picture, layers.take()) {
                // View-dependent colours of a file repeat the materials.
                (UnlitPicture::Materials, Some(image)) => return Ok(image),
                (UnlitPicture::Depths, _) => Channels::Training,
                (UnlitPicture::Layers | UnlitPicture::Materials, _) => Channels::Layers,
            };
            done += 1;
            progress(done, all);
            let image = renderer.render_lit(SceneRenderer::SCENE_LIGHT, camera, &RenderRules { channels, ..rules })?;
            layers = (picture == UnlitPicture::Layers).then(|| image.clone());
            Ok(image)
        };
        let white = Environment { resolution: 1, activation: RadianceActivation::Identity, values: vec![1.0; 18] };
        let sky = UnderSky { sky: &Sky::new(&white), is_of_materials: true };
        let found = fused(&self.scene.gaussians, &cameras, VOXELS, Some(sky), &mut render)?;
        self.scene.near_field = found.map(|found| Surface::shared(found.near_field));
        Ok(())
    }
}
