//! Parts of several benches: scenes of specula's profiles, their work on the CPU, trained models.

#![allow(dead_code, reason = "each program uses a part")]

pub(crate) mod trained;
pub(crate) mod work;

use core::f32::consts::TAU;
use specula_benches::{at_angles, scene::Scene};
use specula_core::{
    executor::Executor,
    near_field::NearField,
    rules::{Channels, RenderRules},
};
use specula_mesh::{Mesh, near_field::SurfaceMeans};
use specula_train::profile::by_name;

/// The torus of a profile's Gaussians, around which rays are traced.
///
/// # Errors
///
/// Any error of the executor.
pub(crate) fn scene<E: Executor>(exec: &mut E, profile: &str, size: u32, count: usize) -> Result<Scene<E>, E::Error> {
    let profile = by_name(profile, 7000).expect("a profile of that name");
    let channels = if profile.layout.is_shaded() { Channels::Training } else { Channels::Color };
    let rules = RenderRules::full(profile.shading, profile.scheme, channels);
    let scene = Scene::new(exec, profile.layout, &rules, &profile.weights, size, count)?;
    Ok(Scene { near_field: Some(near_field()), ..scene })
}

/// Surface of the torus as rays hit it: a mesh of 2 · 512 · 128 triangles.
fn near_field() -> NearField<Vec<f32>> {
    const AROUND: u32 = 512;
    const ACROSS: u32 = 128;
    let mut mesh = Mesh::default();
    for (k, l) in (0..AROUND).flat_map(|k| (0..ACROSS).map(move |l| (k, l))) {
        let [around, across] = [k as f32 / AROUND as f32, l as f32 / ACROSS as f32].map(|share| TAU * share);
        let (position, normal) = at_angles(around, across);
        mesh.positions.push(position);
        mesh.normals.push(normal);
        mesh.colors.push([0.6, 0.4, 0.3]);
        let at = |k: u32, l: u32| k % AROUND * ACROSS + l % ACROSS;
        let [a, b, c, d] = [at(k, l), at(k + 1, l), at(k + 1, l + 1), at(k, l + 1)];
        mesh.triangles.extend([[a, b, c], [a, c, d]]);
    }
    SurfaceMeans::new(mesh, 0.01).near_field().expect("there are triangles")
}
