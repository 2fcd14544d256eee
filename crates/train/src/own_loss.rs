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
//! # let views = [View { name: "grey".into(), camera, rgba, normals: None }];
//! # let profile = by_name("specula", 10).expect("a profile that there is");
//! # let (iterations, background) = (10, [1.0; 3]);
//! # let settings = Settings { profile, iterations, seed: 0, background, random_points: 500 };
//! # let mut trainer = Trainer::new(CpuExecutor::new(), settings, &views, &[])?;
//! // Draws the accumulated depth Σ w t towards 3.
//! let loss = HostLoss(|picture: &HostPicture<'_>, grad: &mut [f32]| {
//!     let depths = picture.plane(channel::DEPTH);
//!     let pixels = depths.len();
//!     let grad = &mut grad[channel::DEPTH * pixels..][..pixels];
//!     for (grad, depth) in grad.iter_mut().zip(depths) {
//!         *grad += 0.1 * (depth - 3.0).signum() / pixels as f32;
//!     }
//! });
//! trainer.set_own_loss(Some(Box::new(loss)));
//! while !trainer.is_finished() {
//!     trainer.step()?;
//! }
//! # Ok::<(), Box<dyn core::error::Error>>(())
//! ```

use crate::evaluate::read_image;
use core::fmt;
use specula_core::{
    camera::Camera,
    executor::{ReadBack, StepPicture},
    rules::RenderRules,
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
    /// Channels in the order of [`channel`](specula_core::rules::channel), then the transmittance.
    /// Channels are sums over splats, w times their value, without a background.
    pub image: &'a Image<Vec<f32>>,
}

impl HostPicture<'_> {
    /// Numbers of a channel, row by row.
    pub fn plane(&self, channel: usize) -> &[f32] {
        self.image.plane(channel)
    }
}

/// Loss as a function on the host: it is given a picture, and adds the gradient of each of its
/// numbers to that of the other losses, which is 0 where no splat is.
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
