//! Losses of the caller, in addition to those of a profile.
//!
//! ```
//! # use glam::Vec3;
//! # use specula_core::camera::Camera;
//! # use specula_cpu::CpuExecutor;
//! use specula_core::rules::channel;
//! use specula_train::own_loss::{HostLoss, HostPicture};
//! # use specula_train::{profile::by_name, trainer::{Settings, Trainer}, view::View};
//! # let camera = Camera::look_at(Vec3::new(0.0, -3.0, 0.5), Vec3::ZERO, Vec3::Z, 0.7, 32, 32);
//! # let rgba = [100, 100, 100, 255].repeat(32 * 32);
//! # let views = [View { name: "grey".into(), camera, rgba, unclipped: None, normals: None }];
//! # let profile = by_name("specula", 10).expect("a profile that there is");
//! # let (iterations, background) = (10, [1.0; 3]);
//! # let settings = Settings { profile, iterations, seed: 0, background, random_points: 500 };
//! # let mut trainer = Trainer::new(CpuExecutor::new(), settings, &views, &[])?;
//! // Draws the accumulated depth Σ w t towards 3, where pictures have depths: not with 3dgs.
//! let loss = HostLoss(|picture: &HostPicture<'_>, grad: &mut [f32]| {
//!     let depths = picture.plane(channel::DEPTH);
//!     let grad = picture.plane_mut(grad, channel::DEPTH);
//!     let Some((depths, grad)) = depths.zip(grad) else { return };
//!     for (grad, depth) in grad.iter_mut().zip(depths) {
//!         *grad += 0.1 * (depth - 3.0).signum() / depths.len() as f32;
//!     }
//! });
//! trainer.set_own_loss(Some(Box::new(loss)));
//! while !trainer.is_finished() {
//!     trainer.step()?;
//!     if trainer.psnr() > Some(40.0) {
//!         trainer.finish_early(100);
//!     }
//! }
//! # Ok::<(), Box<dyn core::error::Error>>(())
//! ```

use crate::evaluate::read_image;
use core::fmt;
use specula_core::{
    camera::Camera,
    executor::{ReadBack, StepPicture},
    rules::{Channels, RenderRules},
    scene::Image,
};

pub use specula_core::executor::PictureLoss;

/// Picture of a training step on the host.
#[derive(Clone, Debug)]
pub struct HostPicture<'a> {
    /// Index of the photograph among those of the training.
    pub view: usize,
    /// Camera, of half the size in the first steps of some profiles.
    pub camera: &'a Camera,
    /// Rules; their shading is physical in steps of materials.
    pub rules: &'a RenderRules,
    /// Blended channels, plane by plane, then the transmittance, which `Image::channels` counts.
    /// Channels are sums over splats, w times their value, without a background; colours are those
    /// after [`shade_pixels`](specula_core::executor::Renderer::shade_pixels).
    pub image: &'a Image<Vec<f32>>,
}

impl HostPicture<'_> {
    /// Numbers of a channel ([`channel`](specula_core::rules::channel)), row by row; `None` if the
    /// profile does not blend it: `3dgs` blends only colours.
    pub fn plane(&self, channel: usize) -> Option<&[f32]> {
        Some(self.image.plane(self.index_of(channel)?))
    }

    /// Transmittance: the share of the background in each pixel.
    pub fn transmittance(&self) -> &[f32] {
        self.image.plane(self.image.channels - 1)
    }

    /// Plane of a channel in the gradient, which has the planes of the picture.
    pub fn plane_mut<'g>(&self, grad: &'g mut [f32], channel: usize) -> Option<&'g mut [f32]> {
        let pixels = self.image.pixel_count();
        Some(&mut grad[self.index_of(channel)? * pixels..][..pixels])
    }

    fn index_of(&self, channel: usize) -> Option<usize> {
        Channels::of_count(self.image.channels - 1).index_of(channel)
    }
}

/// Loss as a function on the host: it is given a picture, and adds the gradient of each of its
/// numbers to that of the other losses, which is 0 where no splat is. A loss of colours over a
/// background adds the colours' gradients times the background to that of the transmittance, the
/// last plane.
///
/// Pictures and gradients are copied to the host and back in every step.
#[derive(Clone, Copy)]
pub struct HostLoss<F>(pub F);

impl<F> fmt::Debug for HostLoss<F> {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str("HostLoss")
    }
}

impl<E: ReadBack, F: Fn(&HostPicture<'_>, &mut [f32])> PictureLoss<E> for HostLoss<F> {
    fn add_grad(
        &self,
        exec: &mut E,
        picture: &StepPicture<'_, E>,
        grad: E::FrameGrad,
    ) -> Result<E::FrameGrad, E::Error> {
        let StepPicture { frame, layout, view, step } = *picture;
        let image = read_image(exec, frame, layout, step.camera, step.rules)?;
        let mut planes = vec![0.0; image.values.len()];
        exec.read_frame_grad(frame, &grad, &mut planes)?;
        (self.0)(&HostPicture { view, camera: step.camera, rules: step.rules, image: &image }, &mut planes);
        exec.upload_frame_grad(frame, &planes)
    }
}
