//! Scenes within a scene.

use crate::{Scene, SceneError, Similarity};
use core::ops::Range;
use specula_core::scene::{Gaussians, Layout, len_of_values};

impl Scene {
    /// Adds a copy of another scene's Gaussians, transformed, after its own; returns their range.
    /// Each call adds one instance. The harmonics have the higher degree of both scenes.
    ///
    /// Light, near field and lamps are those of this scene. Rays of reflections and lamps do not
    /// hit added Gaussians. A renderer must be given this scene again
    /// ([`SceneRenderer::set_scene`](crate::SceneRenderer::set_scene)); without an upload of
    /// everything, [`update`](crate::SceneRenderer::update) turns spare Gaussians into others.
    ///
    /// # Errors
    ///
    /// [`SceneError::OtherModel`] if the scenes differ in shading model, materials or
    /// anti-aliasing; this scene is unchanged.
    pub fn insert(&mut self, other: &Self, at: &Similarity) -> Result<Range<usize>, SceneError> {
        let sh_degree = self.gaussians.layout.sh_degree.max(other.gaussians.layout.sh_degree);
        let [own, added] =
            [&self.gaussians, &other.gaussians].map(|gaussians| Layout { sh_degree, ..gaussians.layout });
        if own != added || self.shading_model != other.shading_model {
            return Err(SceneError::OtherModel);
        }
        let [first, second] = [self.gaussians.count, other.gaussians.count];
        let count = first + second;
        let mut joined = Gaussians { count, layout: own, values: vec![0.0; len_of_values(count, own)] };
        copy(&self.gaussians, &mut joined, 0);
        copy(&other.gaussians, &mut joined, first);
        at.transform(&mut joined, first..count);
        self.gaussians = joined;
        Ok(first..count)
    }
}

/// Copies Gaussians to the indices from `start`; those of `into` may have more harmonics.
fn copy(from: &Gaussians<Vec<f32>>, into: &mut Gaussians<Vec<f32>>, start: usize) {
    let added_planes = into.layout.sh_end() - from.layout.sh_end();
    for plane in 0..from.layout.plane_count() {
        let target = if plane < from.layout.sh_end() { plane } else { plane + added_planes };
        for index in 0..from.count {
            into.set(start + index, target, from.get::<1>(index, plane));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ShadingModel;
    use glam::{DQuat, DVec3, Vec3};
    use specula_core::{camera::Camera, rules::Channels};
    use specula_cpu::CpuExecutor;
    use specula_oracle::scenes::random_cloud;

    fn scene(layout: Layout, count: usize) -> Scene {
        Scene::unlit(random_cloud(count, layout, 5), ShadingModel::PAPER)
    }

    fn picture(scene: &Scene) -> Vec<f32> {
        let camera = Camera::look_at(Vec3::new(0.3, -4.0, 1.0), Vec3::ZERO, Vec3::Z, 0.8, 48, 40);
        scene.renderer(CpuExecutor::new(), Channels::Color).unwrap().render(&camera).unwrap().values
    }

    #[test]
    fn parts_of_a_scene_that_are_joined_again_have_its_picture() {
        let whole = scene(Layout::radiance(2), 75);
        let indices: Vec<usize> = (0..75).collect();
        let [mut first, second] = [&indices[..37], &indices[37..]].map(|kept| whole.kept(kept));
        let at = Similarity::new(DQuat::IDENTITY, 1.0, DVec3::ZERO);
        assert_eq!(first.insert(&second, &at).unwrap(), 37..75);
        assert!(first.gaussians.count == 75 && picture(&first) == picture(&whole));
    }

    #[test]
    fn instances_are_where_their_transforms_put_them() {
        let part = scene(Layout::shaded(Some(1)).physical().antialiased(), 20);
        let at = Similarity::new(DQuat::from_rotation_z(0.7), 0.5, DVec3::new(0.4, 0.1, -0.2));
        let mut moved = part.clone();
        at.transform(&mut moved.gaussians, 0..20);
        let mut room = scene(Layout::shaded(None).physical().antialiased(), 33);
        let empty = room.clone();
        for start in [33, 53] {
            assert_eq!(room.insert(&part, &at).unwrap(), start..start + 20);
        }
        assert_eq!(room.gaussians.layout, part.gaussians.layout, "the higher degree");
        let layout = part.gaussians.layout;
        for (index, plane) in (0..20).flat_map(|index| (0..layout.plane_count()).map(move |plane| (index, plane))) {
            let expected = moved.gaussians.get::<1>(index, plane);
            assert_eq!([33, 53].map(|start| room.gaussians.get::<1>(start + index, plane)), [expected; 2]);
        }
        assert!(picture(&room.kept(&(0..33).collect::<Vec<_>>())) == picture(&empty), "zeros are no harmonics");
    }

    #[test]
    fn other_models_are_refused() {
        let mut room = scene(Layout::shaded(None), 8);
        let before = room.gaussians.clone();
        let at = Similarity::new(DQuat::IDENTITY, 1.0, DVec3::ZERO);
        let physical = scene(Layout::shaded(None).physical(), 8);
        let official = Scene { shading_model: ShadingModel::OFFICIAL, ..room.clone() };
        for other in [scene(Layout::radiance(0), 8), physical, official] {
            assert!(matches!(room.insert(&other, &at), Err(SceneError::OtherModel)));
        }
        assert_eq!(room.gaussians, before);
    }
}
