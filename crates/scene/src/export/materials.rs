//! Physical materials of Gaussians for other programs.

use crate::bake::{ActivatedAttributes, normal};
use glam::Vec3;
use specula_core::{
    covariance::rotation,
    normal::{AxisRule, axis},
    scene::{Gaussians, LOG_SCALE, QUAT},
    shade::ShadingRules,
    vector::vec3,
};
use specula_io::gaussian_ply::SurfaceMaterial;

/// Physical materials of Gaussians with these normals, each on the side of the cameras. The written
/// Gaussians `plain` are turned, which changes no shape, so that their shortest axes point to that
/// side.
pub(super) fn surface_materials(
    gaussians: &Gaussians<Vec<f32>>,
    shading: ShadingRules,
    normals: &[[f32; 3]],
    plain: &mut Gaussians<Vec<f32>>,
) -> Vec<SurfaceMaterial> {
    let material = |(index, found): (usize, &[f32; 3])| {
        let axis = shortest_axis(plain, index);
        let found = Vec3::from(*found);
        let sides = [axis, -axis].map(|towards| normal(gaussians, index, towards, shading));
        let [front, back] = sides.map(|side| found.distance_squared(side.into()));
        if back < front {
            turn_axis(plain, index);
        }
        let ActivatedAttributes { diffuse, tint, roughness } =
            ActivatedAttributes::of(gaussians, index, ShadingRules::PHYSICAL);
        SurfaceMaterial {
            normal: found.to_array(),
            back: if back < front { sides[0] } else { sides[1] },
            // Albedo and metalness replace diffuse colour and tint.
            albedo: diffuse,
            metalness: tint[0],
            roughness,
        }
    };
    normals.iter().enumerate().map(material).collect()
}

/// Shortest axis of a Gaussian, a unit vector.
fn shortest_axis(gaussians: &Gaussians<Vec<f32>>, index: usize) -> Vec3 {
    let [x, y, z] = gaussians.get(index, LOG_SCALE);
    axis(AxisRule::Shortest, &rotation(gaussians.get(index, QUAT)), vec3(x, y, z)).to_array().into()
}

/// Reverses the shortest axis of a Gaussian by half a turn about another of its axes.
fn turn_axis(gaussians: &mut Gaussians<Vec<f32>>, index: usize) {
    let [x, y, z]: [f32; 3] = gaussians.get(index, LOG_SCALE);
    let [w, i, j, k]: [f32; 4] = gaussians.get(index, QUAT);
    // The quat times (0, 1, 0, 0) or (0, 0, 1, 0).
    let turned = if x <= y && x <= z { [-j, -k, w, i] } else { [-i, w, k, -j] };
    gaussians.set(index, QUAT, turned);
}

#[cfg(test)]
mod tests {
    use super::*;
    use specula_core::{
        covariance::covariance,
        scene::{Layout, len_of_values},
    };

    #[test]
    fn turned_axes() {
        for log_scales in [[-3.0, -1.0, -2.0], [-1.0, -3.0, -2.0], [-2.0, -1.0, -3.0], [-1.0; 3]] {
            let layout = Layout::radiance(0);
            let mut gaussians = Gaussians { count: 1, layout, values: vec![0.0; len_of_values(1, layout)] };
            gaussians.set(0, LOG_SCALE, log_scales);
            gaussians.set(0, QUAT, [0.1, -0.7, 0.5, 0.5]);
            let shape = |gaussians: &Gaussians<Vec<f32>>| {
                let [x, y, z] = gaussians.get(0, LOG_SCALE);
                covariance(gaussians.get(0, QUAT), vec3(x, y, z))
            };
            let before = (shortest_axis(&gaussians, 0), shape(&gaussians));
            turn_axis(&mut gaussians, 0);
            assert!((shortest_axis(&gaussians, 0) + before.0).length() < 1e-6, "{log_scales:?}");
            assert!(shape(&gaussians).iter().zip(before.1).all(|(a, b)| (a - b).abs() < 1e-6), "{log_scales:?}");
        }
    }
}
