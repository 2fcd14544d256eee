//! Exposure: the affine map of colours of a photograph.

use crate::{
    codegen::{source::Source, uniform::uniform},
    device::{
        context::Context,
        error::GpuError,
        kernels::{
            Binding::{Buffer, Uniform},
            Dispatch,
        },
    },
    stages::frame::Frame,
};
use formulas::Expose;
use specula_core::expose::Exposure;

pub mod formulas;

uniform! {
    /// Exposure, and size of a frame.
    pub(crate) struct ExposureSettings {
        red: [f32; 4],
        green: [f32; 4],
        blue: [f32; 4],
        pub(crate) size: [u32; 2],
        padding: [u32; 2],
    }
}

impl ExposureSettings {
    pub(crate) fn new(exposure: &Exposure<f32>, frame: &Frame) -> Self {
        let [red, green, blue] = *exposure;
        Self { red, green, blue, size: frame.size.map(|pixels| pixels as u32), padding: [0; 2] }
    }
}

/// Appends the exposure and the pixels of a frame.
pub(crate) fn exposure(source: Source, channels: usize) -> Source {
    source.count("CHANNELS", channels).uniform::<ExposureSettings>().with(include_str!("exposure.wgsl"))
}

pub(crate) fn source(channels: usize) -> String {
    let source = Source::new().part(|source| exposure(source, channels));
    source.formula(&Expose).with(include_str!("expose.wgsl")).text()
}

/// Exposes all pixels of a frame.
///
/// # Errors
///
/// See [`Context::allocate`] and [`Context::dispatch`].
pub(crate) fn expose(context: &mut Context, mut frame: Frame, exposure: &Exposure<f32>) -> Result<Frame, GpuError> {
    let exposed = context.allocate("colours of a photograph", 3 * frame.pixel_count())?;
    let settings = ExposureSettings::new(exposure, &frame);
    let bindings =
        [Uniform(settings.bytes()), Buffer(&frame.blended), Buffer(frame.color_before_exposure()), Buffer(&exposed)];
    let channels = frame.channels;
    let (key, source) = (format!("{channels} channels"), || source(channels));
    context.dispatch(&key, "expose", &source, &bindings, Dispatch::Invocations(frame.pixel_count()))?;
    frame.exposed = Some(exposed);
    Ok(frame)
}
