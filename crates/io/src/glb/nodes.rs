//! Nodes of a document's scene that have Gaussians, with their transforms.

use super::{
    SPLATTING,
    document::{File, Node, Primitive},
};
use crate::{affine::UNIFORM, error::Result};
use glam::{DAffine3, DMat3, DMat4, DQuat, DVec3};
use std::collections::HashSet;

/// Extension that repeats the mesh of a node.
const INSTANCING: &str = "EXT_mesh_gpu_instancing";
/// Maximum number of lists of Gaussians in a scene; nodes may repeat lists.
const LISTS_MAX: usize = 1 << 16;

/// A list of Gaussians in the world.
pub(super) struct Placed<'a> {
    pub(super) primitive: &'a Primitive,
    pub(super) world: DAffine3,
    /// Origin that the node names, else zero.
    pub(super) origin: [f64; 3],
    /// Rotation of the nodes above, if they name any.
    rotation: Option<DQuat>,
}

/// Transform of the nodes above a node.
#[derive(Clone, Copy)]
struct Above {
    world: DAffine3,
    rotation: Option<DQuat>,
}

impl Above {
    const NONE: Self = Self { world: DAffine3::IDENTITY, rotation: None };
}

impl Placed<'_> {
    /// True if nodes rotate and scale the list, but do not stretch, shear or mirror it.
    pub(super) fn is_similar(&self) -> bool {
        let matrix = self.world.matrix3;
        let scale = matrix.determinant().cbrt();
        let rotation = DMat3::from_quat(self.rotation.unwrap_or_default().normalize());
        scale > 0.0 && (matrix * scale.recip()).abs_diff_eq(rotation, UNIFORM)
    }

    /// Up direction in the world of a similar list: +y as in glTF; +z for files of this program
    /// without a rotation, which use the world of the data set.
    pub(super) fn up(&self, is_of_data: bool) -> [f64; 3] {
        let rotation = match self.rotation {
            None if is_of_data => return [0.0, 0.0, 1.0],
            None => DQuat::IDENTITY,
            Some(rotation) => rotation,
        };
        (rotation.inverse() * DVec3::Y).normalize().to_array()
    }
}

impl File<'_> {
    /// Lists of Gaussians of the scene; if it has none, of all nodes, with a note; without nodes,
    /// of all meshes.
    pub(super) fn placed(&self, notes: &mut Vec<String>) -> Result<Vec<Placed<'_>>> {
        let document = &self.document;
        let mut placed = Vec::new();
        if document.nodes.is_empty() {
            (0..document.meshes.len()).try_for_each(|mesh| self.place(mesh, Above::NONE, [0.0; 3], &mut placed))?;
        }
        if let Some(scene) = document.scenes.get(document.scene) {
            self.place_below(&scene.nodes, &mut placed)?;
        }
        if placed.is_empty() {
            self.place_below(&self.roots(), &mut placed)?;
            if !placed.is_empty() && !document.scenes.is_empty() {
                notes.push(format!("{:?} has Gaussians only outside of its scene; these are rendered", self.path));
            }
        }
        if placed.is_empty() {
            let has_others = document.meshes.iter().any(|mesh| !mesh.primitives.is_empty());
            return Err(match has_others {
                true => self.broken(&format_args!(
                    "it is a mesh, without Gaussians ({SPLATTING}); open it in a viewer of meshes, such as Blender"
                )),
                false => self.broken(&format_args!("it has no Gaussians with {SPLATTING}")),
            });
        }
        Ok(placed)
    }

    /// Lists of Gaussians of nodes and those below them.
    fn place_below<'a>(&'a self, roots: &[usize], placed: &mut Vec<Placed<'a>>) -> Result<()> {
        let mut is_known = vec![false; self.document.nodes.len()];
        let mut ahead: Vec<(usize, Above)> = roots.iter().rev().map(|node| (*node, Above::NONE)).collect();
        while let Some((index, above)) = ahead.pop() {
            let node = self.document.nodes.get(index);
            let node = node.ok_or_else(|| self.broken(&format_args!("it has no node {index}")))?;
            if core::mem::replace(&mut is_known[index], true) {
                return Err(self.broken(&format_args!("its node {index} is named more than once")));
            }
            let here = below(above, node);
            let before = placed.len();
            if let Some(mesh) = node.mesh {
                self.place(mesh, here, node.origin(), placed)?;
            }
            if placed.len() > before {
                self.refuse_unknown_place(index, node, here)?;
            }
            ahead.extend(node.children.iter().rev().map(|child| (*child, here)));
        }
        Ok(())
    }

    /// Rejects a node of Gaussians with an unknown transform.
    fn refuse_unknown_place(&self, index: usize, node: &Node, here: Above) -> Result<()> {
        let determinant = here.world.matrix3.determinant();
        if !here.world.is_finite() || !determinant.is_finite() || determinant == 0.0 {
            return Err(self.broken(&format_args!("the transform of its node {index} has no inverse")));
        }
        if node.extensions.contains_key(INSTANCING) {
            return Err(self.broken(&format_args!("its node {index} has {INSTANCING}, which is not supported")));
        }
        Ok(())
    }

    /// Root nodes.
    fn roots(&self) -> Vec<usize> {
        let mut is_child = vec![false; self.document.nodes.len()];
        for child in self.document.nodes.iter().flat_map(|node| &node.children) {
            is_child.get_mut(*child).into_iter().for_each(|is_child| *is_child = true);
        }
        (0..is_child.len()).filter(|node| !is_child[*node]).collect()
    }

    fn place<'a>(&'a self, mesh: usize, at: Above, origin: [f64; 3], placed: &mut Vec<Placed<'a>>) -> Result<()> {
        let primitives = self.document.meshes.get(mesh).map_or(&[][..], |mesh| &mesh.primitives);
        let lists = primitives.iter().filter(|primitive| primitive.has_gaussians());
        let lists = lists.map(|primitive| Placed { primitive, world: at.world, origin, rotation: at.rotation });
        placed.extend(lists.take(LISTS_MAX + 1));
        if placed.len() > LISTS_MAX {
            return Err(self.broken(&format_args!("it has more than {LISTS_MAX} lists of Gaussians")));
        }
        Ok(())
    }

    /// Note on parts of a document that are not rendered.
    pub(super) fn left_out(&self, placed: &[Placed<'_>]) -> Option<String> {
        let shown: HashSet<*const Primitive> =
            placed.iter().map(|placed| core::ptr::from_ref(placed.primitive)).collect();
        let primitives = self.document.meshes.iter().flat_map(|mesh| &mesh.primitives);
        let (lists, meshes): (Vec<_>, Vec<_>) = primitives.partition(|primitive| primitive.has_gaussians());
        let counts = [
            (meshes.len(), "meshes"),
            (lists.len() - shown.len(), "lists of Gaussians outside of its scene"),
            (self.document.animations.len(), "animations"),
        ];
        let counts = counts.into_iter().filter(|(count, _)| *count > 0);
        let names: Vec<String> = counts.map(|(count, name)| format!("{count} {name}")).collect();
        (!names.is_empty()).then(|| format!("{:?} has {} that are not rendered", self.path, names.join(" and ")))
    }
}

impl Primitive {
    pub(super) fn has_gaussians(&self) -> bool {
        self.extensions.contains_key(SPLATTING)
    }
}

/// Transform of a node below others.
fn below(above: Above, node: &Node) -> Above {
    let named = match (&node.matrix, &node.rotation) {
        (Some(matrix), _) => {
            let linear = DMat3::from_mat4(DMat4::from_cols_array(matrix));
            Some(DQuat::from_mat3(&(linear * linear.determinant().abs().cbrt().recip())))
        }
        (None, Some(rotation)) => Some(DQuat::from_array(**rotation)),
        (None, None) => None,
    };
    let local = node.matrix.as_ref().map(|matrix| DAffine3::from_mat4(DMat4::from_cols_array(matrix)));
    let local = local.unwrap_or_else(|| {
        let scale = node.scale.as_ref().map_or(DVec3::ONE, |scale| DVec3::from(**scale));
        let rotation = named.unwrap_or_default().normalize();
        let translation = node.translation.as_ref().map_or(DVec3::ZERO, |translation| DVec3::from(**translation));
        DAffine3::from_scale_rotation_translation(scale, rotation, translation)
    });
    let rotation = match (above.rotation, named) {
        (Some(above), Some(named)) => Some(above * named),
        (above, named) => named.or(above),
    };
    Above { world: above.world * local, rotation }
}
