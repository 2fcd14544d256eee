//! Light of lamps on a blended surface, with shadows.

use crate::{
    codegen::source::Source,
    device::{
        context::Context,
        error::GpuError,
        kernels::{
            Binding::{Buffer, Uniform},
            Dispatch,
        },
        memory::Array,
    },
    stages::{
        camera::{CameraUniform, camera},
        frame::Frame,
        trace::{NearFieldUniform, traversal},
    },
};
use bytemuck::{Pod, Zeroable};
use formulas::{
    AxesOfDisc, DIRECT_LEN, DirectLightOf, LAMP_LEN, LitPixelOf, ShadowRayOf, ShareSeen, ShiftOfPixel, TowardLamp,
};
use specula_core::{
    camera::Camera,
    executor::Occluder,
    lamps::{self, Lamp, spiral_point},
    near_field::{BELOW, NearField},
    rules::Channels,
};
use std::sync::Arc;

pub mod formulas;

/// Numbers of a vector, in which the numbers of lamps are read.
const VECTOR: usize = 4;

pub(crate) fn source(blended: Channels) -> String {
    Source::new()
        .real()
        .part(camera)
        .count("LAMP_VECTORS", LAMP_LEN / VECTOR)
        .number("BELOW", BELOW)
        .part(traversal)
        .formula(&LitPixelOf(blended))
        .formula(&TowardLamp)
        .formula(&AxesOfDisc)
        .formula(&ShiftOfPixel)
        .formula(&ShadowRayOf)
        .formula(&ShareSeen)
        .formula(&DirectLightOf)
        .with(include_str!("illuminate.wgsl"))
        .text()
}

/// Lamps on the device, and the surfaces that cast their shadows.
#[derive(Debug)]
pub(crate) struct Lamps {
    set: LampsUniform,
    /// Numbers of the lamps, then the points of a lamp that is wider than a point.
    numbers: Array,
    occluder: Option<Arc<NearField<Array>>>,
    /// Irradiance / π of the occluder's vertices by reflected light; one number for none.
    reflected: Array,
}

/// `Lamps` of `illuminate.wgsl`.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct LampsUniform {
    count: u32,
    rays: u32,
    /// 1 where surfaces reflect light onto each other.
    is_reflected: u32,
    padding: u32,
}

impl Lamps {
    /// Uploads lamps with this many shadow rays to each that is wider than a point.
    ///
    /// # Errors
    ///
    /// [`GpuError::Lamps`] if they have a fault; see also [`Context::upload`].
    pub(crate) fn new(
        context: &mut Context,
        lamps: &[Lamp],
        rays: usize,
        occluder: Option<Occluder<'_, Arc<NearField<Array>>>>,
    ) -> Result<Self, GpuError> {
        lamps::check(lamps, rays).map_err(GpuError::Lamps)?;
        let reflected = occluder.as_ref().map_or(&[][..], |occluder| occluder.reflected);
        let occluder = occluder.map(|occluder| occluder.surface.clone());
        let vertex_count = occluder.as_ref().map_or(0, |occluder| occluder.vertex_count);
        lamps::check_reflected(vertex_count, reflected).map_err(GpuError::Lamps)?;
        let spiral = (0..rays).flat_map(|k| spiral_point(k, rays));
        let numbers: Vec<f32> = lamps.iter().flat_map(Lamp::numbers).chain(spiral).collect();
        let is_reflected = !reflected.is_empty();
        let set = LampsUniform {
            count: lamps.len() as u32,
            rays: rays as u32,
            is_reflected: is_reflected.into(),
            padding: 0,
        };
        let reflected = if is_reflected { reflected } else { &[0.0] };
        Ok(Self {
            set,
            numbers: context.upload("numbers of lamps", &numbers)?,
            occluder,
            reflected: context.upload("reflected light of lamps", reflected)?,
        })
    }
}

/// Evaluates the direct light of lamps in all pixels. A frame without all layers, or of a light
/// without lamps, is returned unchanged.
///
/// # Errors
///
/// See [`Context::allocate`] and [`Context::dispatch`].
pub(crate) fn illuminate(
    context: &mut Context,
    mut frame: Frame,
    lamps: Option<&Lamps>,
    camera: &Camera,
) -> Result<Frame, GpuError> {
    let blended = Channels::of_count(frame.channels);
    let has_layers = blended == Channels::Layers;
    let Some(lamps) = lamps.filter(|_| has_layers) else { return Ok(frame) };
    let nothing = context.allocate("no near field", VECTOR)?;
    let (near_field, numbers) = match lamps.occluder.as_deref() {
        Some(occluder) => (NearFieldUniform::new(occluder), &occluder.values),
        None => (NearFieldUniform::zeroed(), &nothing),
    };
    let view = CameraUniform::new(camera, 0);
    let direct = context.allocate("light of lamps", DIRECT_LEN * frame.pixel_count())?;
    let bindings = [
        Uniform(view.bytes()),
        Uniform(bytemuck::bytes_of(&near_field)),
        Buffer(&frame.blended),
        Buffer(numbers),
        Buffer(&lamps.numbers),
        Uniform(bytemuck::bytes_of(&lamps.set)),
        Buffer(&direct),
        Buffer(&lamps.reflected),
    ];
    let (key, source) = (format!("{blended:?}"), || source(blended));
    context.dispatch(&key, "illuminate", &source, &bindings, Dispatch::Invocations(frame.pixel_count()))?;
    frame.direct = Some(direct);
    Ok(frame)
}
