//! Surface of a scene with its visibility.

use crate::sight::Sight;
use core::ops::Deref;
use specula_core::near_field::NearField;
use std::sync::{Arc, OnceLock};

/// Near field of fixed geometry, and its visibility, which is computed once, on first use, for all
/// lights and all copies in other colours.
#[derive(Clone, Debug)]
pub struct Surface {
    near_field: NearField<Vec<f32>>,
    sight: Arc<OnceLock<Sight>>,
}

impl Surface {
    /// Surface to be shared.
    pub fn shared(near_field: NearField<Vec<f32>>) -> Arc<Self> {
        Arc::new(near_field.into())
    }

    /// Vertices that each vertex sees.
    pub fn sight(&self) -> &Sight {
        self.sight.get_or_init(|| Sight::new(&self.near_field))
    }

    /// Unwraps the near field.
    pub fn into_near_field(self) -> NearField<Vec<f32>> {
        self.near_field
    }

    /// The same surface in other colours: `change` must not modify positions, normals and
    /// triangles.
    #[must_use]
    pub fn recolored(&self, change: impl FnOnce(&mut NearField<Vec<f32>>)) -> Self {
        let mut recolored = self.clone();
        change(&mut recolored.near_field);
        recolored
    }
}

impl From<NearField<Vec<f32>>> for Surface {
    fn from(near_field: NearField<Vec<f32>>) -> Self {
        Self { near_field, sight: Arc::default() }
    }
}

impl Deref for Surface {
    type Target = NearField<Vec<f32>>;

    fn deref(&self) -> &NearField<Vec<f32>> {
        &self.near_field
    }
}

impl PartialEq for Surface {
    fn eq(&self, other: &Self) -> bool {
        self.near_field == other.near_field
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Mesh, near_field::SurfaceMeans};

    #[test]
    fn copies_in_other_colors_share_one_sight() {
        let mesh = Mesh {
            positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            normals: vec![[0.0, 0.0, 1.0]; 3],
            colors: vec![[0.5; 3]; 3],
            triangles: vec![[0, 1, 2]],
        };
        let surface = Surface::from(SurfaceMeans::new(mesh, 0.01).near_field().expect("there is a triangle"));
        let black = surface.recolored(|surface| surface.vertices_mut()[0][6] = 0.0);
        assert_ne!(surface, black);
        assert!(core::ptr::eq(surface.sight(), black.sight()));
        assert!(!core::ptr::eq(surface.sight(), Surface::from(black.into_near_field()).sight()));
    }
}
