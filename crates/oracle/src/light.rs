//! Light into roughness levels by explicit rows of weights, and its lookup.

use crate::{
    illuminate::Lamps,
    number::{Number, take3},
};
use rayon::prelude::*;
use specula_core::{
    cubemap::{self, FACE_COUNT},
    double::Double,
    environment::{self, radiance_vjp},
    light_network::{ENCODING, WEIGHT_MAX, attenuations, bounded, bounded_vjp, encode, evaluate, evaluate_vjp},
    light_view::{LightView, TexelMap},
    near_field::NearField,
    prefilter::{Levels, Lobe, Node, PrefilterScheme},
    scene::Environment,
    vector::{Vec3, vec3},
};
use std::sync::Arc;

/// Resolution of the nodes at which every row starts.
const COARSEST: usize = 4;

/// The linear map from a light to its levels ([`PrefilterScheme::Exact`]).
#[derive(Clone, Debug)]
pub struct Operator {
    /// The levels.
    pub levels: Levels,
    /// Resolution and first node of each step of the pyramid of means, finest first.
    pyramid: Vec<(usize, usize)>,
    /// Factor by which nodes are narrower than those of executors.
    fineness: usize,
    /// For each level a row of (node, weight) for each texel.
    rows: Vec<Vec<Vec<(usize, f64)>>>,
}

/// Direction and solid angle of each node down to half the width of the base's, which rows need
/// often.
struct Places {
    /// By resolution, finest first.
    levels: Vec<Vec<(Vec3<Double>, f64)>>,
    finest: usize,
}

impl Places {
    fn new(base: usize) -> Self {
        let place = |node: &Node| (node.direction(), node.solid_angle());
        let level = |resolution: usize| {
            let nodes: Vec<Node> = texels_of(resolution).collect();
            nodes.par_iter().map(place).collect()
        };
        let finest = 2 * base;
        let sizes = core::iter::successors(Some(finest), |size| Some(size / 2));
        Self { levels: sizes.take_while(|size| *size >= 1).map(level).collect(), finest }
    }

    fn of(&self, node: &Node) -> (Vec3<Double>, f64) {
        let level = (self.finest / node.resolution).ilog2() as usize;
        self.levels[level][cubemap::texel_index(node.face, node.column, node.row, node.resolution)]
    }
}

/// Texels of a map without apron, in order.
fn texels_of(resolution: usize) -> impl Iterator<Item = Node> {
    let row = move |face, row| (0..resolution).map(move |column| Node { face, column, row, resolution });
    (0..FACE_COUNT).flat_map(move |face| (0..resolution).flat_map(move |index| row(face, index)))
}

impl Operator {
    /// The operator of a base of this resolution.
    pub fn new(resolution: usize) -> Self {
        Self::finer(resolution, 1)
    }

    /// Operator from nodes that are `fineness` times narrower, a power of two, over lobes without a
    /// cutoff: the limit is the sum over all texels.
    pub fn finer(resolution: usize, fineness: usize) -> Self {
        let levels = Levels::new(PrefilterScheme::Exact, resolution);
        let mut pyramid = vec![(resolution, 0)];
        while let [.., (size, first)] = pyramid[..]
            && size > COARSEST
        {
            pyramid.push((size / 2, first + FACE_COUNT * size * size));
        }
        let mut operator = Self { levels, pyramid, fineness, rows: Vec::new() };
        let places = Places::new(resolution);
        for level in levels.as_slice() {
            let alpha_ggx = f64::from(level.roughness) * f64::from(level.roughness);
            let texels: Vec<Node> = texels_of(level.resolution).collect();
            let rows = texels.par_iter().map(|texel| operator.row(texel, alpha_ggx, &places)).collect();
            operator.rows.push(rows);
        }
        operator
    }

    /// Weights of a texel's nodes; they sum to one. At roughness 0 the only node is the texel
    /// itself.
    fn row(&self, texel: &Node, alpha_ggx: f64, places: &Places) -> Vec<(usize, f64)> {
        if alpha_ggx == 0.0 {
            return vec![(self.index(texel), 1.0)];
        }
        let base = self.pyramid[0].0;
        let lobe = Lobe::new(texel.direction(), alpha_ggx);
        let mut open: Vec<Node> = texels_of(COARSEST.min(base)).collect();
        let mut row = Vec::new();
        while let Some(node) = open.pop() {
            let (direction, _) = places.of(&node);
            if self.fineness == 1 && !lobe.sees(direction, node.resolution) {
                continue;
            }
            if node.resolution < base && lobe.must_open(direction, node.resolution / self.fineness) {
                open.extend(node.children());
            } else {
                let quarters = node.children().map(|child| places.of(&child));
                row.push((self.index(&node), lobe.weight(&quarters)));
            }
        }
        row.retain(|(_, weight)| *weight > 0.0);
        let sum: f64 = row.iter().map(|(_, weight)| weight).sum();
        row.iter_mut().for_each(|(_, weight)| *weight /= sum);
        row
    }

    fn index(&self, node: &Node) -> usize {
        let first = self.pyramid.iter().find(|(size, _)| *size == node.resolution).expect("a size of the pyramid").1;
        first + cubemap::texel_index(node.face, node.column, node.row, node.resolution)
    }

    /// Each node above the base with its four children and their shares of its solid angle; finest
    /// first.
    fn means(&self) -> impl Iterator<Item = (usize, [(usize, f64); 4])> {
        self.pyramid[1..].iter().flat_map(|(size, _)| texels_of(*size)).map(|node| {
            let children = node.children();
            let sum: f64 = children.iter().map(Node::solid_angle).sum();
            (self.index(&node), children.map(|child| (self.index(&child), child.solid_angle() / sum)))
        })
    }

    fn node_count(&self) -> usize {
        self.pyramid.iter().map(|(size, _)| FACE_COUNT * size * size).sum()
    }

    /// Every level of a base, without aprons.
    pub fn apply<R: Number>(&self, base: &[Vec3<R>]) -> Vec<Vec<Vec3<R>>> {
        let zero = Vec3::zero(R::of(0.0));
        let mut nodes = base.to_vec();
        nodes.resize(self.node_count(), zero);
        for (node, children) in self.means() {
            nodes[node] =
                children.iter().fold(zero, |sum, (child, share)| sum.add_scaled(R::of(*share), nodes[*child]));
        }
        let filter = |row: &Vec<(usize, f64)>| {
            row.iter().fold(zero, |sum, (node, weight)| sum.add_scaled(R::of(*weight), nodes[*node]))
        };
        self.rows.iter().map(|rows| rows.iter().map(filter).collect()).collect()
    }

    /// The transposed map: gradients of every level to that of the base.
    pub fn apply_transposed<R: Number>(&self, grads: &[Vec<Vec3<R>>]) -> Vec<Vec3<R>> {
        let mut nodes = vec![Vec3::zero(R::of(0.0)); self.node_count()];
        for (row, grad) in self.rows.iter().flatten().zip(grads.iter().flatten()) {
            for (node, weight) in row {
                nodes[*node] = nodes[*node].add_scaled(R::of(*weight), *grad);
            }
        }
        for (node, children) in self.means().collect::<Vec<_>>().into_iter().rev() {
            for (child, share) in children {
                nodes[child] = nodes[child].add_scaled(R::of(share), nodes[node]);
            }
        }
        let base = self.pyramid[0].0;
        nodes.truncate(FACE_COUNT * base * base);
        nodes
    }
}

/// A light filtered into levels, each with its apron.
#[derive(Clone, Debug)]
pub struct Light<R> {
    /// The levels.
    pub levels: Levels,
    /// Their maps.
    pub maps: Vec<TexelMap>,
    /// Texels of all maps, with aprons.
    pub texels: Vec<Vec3<R>>,
    /// Surface of the scene that reflected rays may hit.
    pub near_field: Option<Arc<NearField<Vec<f32>>>>,
    /// Lamps in addition to the distant light.
    pub lamps: Option<Arc<Lamps>>,
}

impl<R> Light<R> {
    /// Levels and their texels, with aprons, one map after the other.
    pub fn new(levels: Levels, texels: Vec<Vec3<R>>) -> Self {
        Self { levels, maps: maps_of(&levels), texels, near_field: None, lamps: None }
    }
    /// The light for lookups.
    pub fn view(&self) -> LightView<'_, R> {
        LightView { levels: self.levels.as_slice(), maps: &self.maps, texels: &self.texels }
    }
    /// Texels of each level, with aprons.
    pub fn level_texels(&self) -> impl Iterator<Item = &[Vec3<R>]> {
        texels_of_maps(&self.maps, &self.texels)
    }
    /// Attaches a near field.
    #[must_use]
    pub fn around(self, near_field: NearField<Vec<f32>>) -> Self {
        Self { near_field: Some(Arc::new(near_field)), ..self }
    }
    /// Attaches lamps.
    #[must_use]
    pub fn with_lamps(self, lamps: Lamps) -> Self {
        Self { lamps: Some(Arc::new(lamps)), ..self }
    }
}

/// The texels of each map.
fn texels_of_maps<'a, R>(maps: &'a [TexelMap], texels: &'a [Vec3<R>]) -> impl Iterator<Item = &'a [Vec3<R>]> {
    maps.iter().map(|map| &texels[map.first..map.end()])
}

/// Maps of levels, one after the other.
fn maps_of(levels: &Levels) -> Vec<TexelMap> {
    TexelMap::side_by_side(levels.as_slice().iter().map(|level| level.resolution)).collect()
}

/// Gradient of a [`Light`], texel by texel.
#[derive(Clone, Debug)]
pub struct LightGrad<R> {
    /// In the order of [`Light::texels`].
    pub texels: Vec<Vec3<R>>,
}

impl<R: Number> LightGrad<R> {
    /// Zero gradient.
    pub fn zero(light: &Light<R>) -> Self {
        Self { texels: vec![Vec3::zero(R::of(0.0)); light.texels.len()] }
    }
}

/// Index of each texel of a padded map, and its source texels without apron.
fn aprons(resolution: usize) -> impl Iterator<Item = (usize, cubemap::Apron)> {
    let end = resolution as isize;
    let texel = move |face, row, column| {
        (cubemap::padded_index(face, column, row, resolution), cubemap::apron_sources(face, column, row, resolution))
    };
    (0..FACE_COUNT)
        .flat_map(move |face| (-1..=end).flat_map(move |row| (-1..=end).map(move |column| texel(face, row, column))))
}

fn radiance<R: Number>(environment: &Environment<Vec<R>>) -> Vec<Vec3<R>> {
    let activate = |number: R| environment::radiance(environment.activation, number);
    environment.values.chunks_exact(3).map(|rgb| take3(rgb).map(activate)).collect()
}

/// Weights of a network within their bounds.
fn bounded_weights<R: Number>(environment: &Environment<Vec<R>>) -> Vec<R> {
    environment.values.iter().map(|weight| bounded(*weight, WEIGHT_MAX)).collect()
}

/// Encoding of each texel of each level.
fn encodings<R: Number>(operator: &Operator) -> impl Iterator<Item = Vec<[R; ENCODING]>> + '_ {
    operator.levels.as_slice().iter().map(|level| {
        let attenuations = attenuations(level.roughness).map(R::of);
        let encoded = |texel: Node| encode(texel.direction().map(|x| R::of(x.0)), &attenuations);
        texels_of(level.resolution).map(encoded).collect()
    })
}

/// Every level of a network light, without aprons.
fn network_levels<R: Number>(environment: &Environment<Vec<R>>, operator: &Operator) -> Vec<Vec<Vec3<R>>> {
    let weights = bounded_weights(environment);
    let texel = |encoding: &[R; ENCODING]| {
        let [x, y, z] = evaluate(&weights, encoding).numbers();
        vec3(x, y, z).map(|number| environment::radiance(environment.activation, number))
    };
    encodings(operator).map(|level_encodings| level_encodings.iter().map(texel).collect()).collect()
}

/// Gradient of [`network_levels`] with respect to the weights.
fn network_levels_vjp<R: Number>(
    environment: &Environment<Vec<R>>,
    operator: &Operator,
    grads: &[Vec<Vec3<R>>],
) -> Vec<R> {
    let weights = bounded_weights(environment);
    let mut out = vec![R::of(0.0); weights.len()];
    for (encoding, grad) in encodings(operator).flatten().zip(grads.iter().flatten()) {
        let answers = evaluate(&weights, &encoding);
        let (numbers, grad) = (answers.numbers(), grad.to_array());
        let grad_numbers = core::array::from_fn(|c| {
            let radiance = environment::radiance(environment.activation, numbers[c]);
            radiance_vjp(environment.activation, radiance, grad[c])
        });
        evaluate_vjp(&weights, &encoding, &answers, grad_numbers, &mut out);
    }
    let gates = out.iter().zip(&environment.values);
    gates.map(|(grad, weight)| bounded_vjp(*weight, WEIGHT_MAX, *grad)).collect()
}

/// Light into levels.
pub fn prefilter<R: Number>(environment: &Environment<Vec<R>>, operator: &Operator) -> Light<R> {
    let filtered = if environment.is_network() {
        network_levels(environment, operator)
    } else {
        operator.apply(&radiance(environment))
    };
    let pad = |(texels, level): (&Vec<Vec3<R>>, &specula_core::prefilter::Level)| {
        let mut map = vec![Vec3::zero(R::of(0.0)); cubemap::padded_len(level.resolution)];
        for (index, apron) in aprons(level.resolution) {
            let share = R::of(1.0 / apron.count as f64);
            let sum = apron.texels[..apron.count].iter().fold(map[index], |sum, texel| sum + texels[*texel]);
            map[index] = sum * share;
        }
        map
    };
    Light::new(operator.levels, filtered.iter().zip(operator.levels.as_slice()).flat_map(pad).collect())
}

/// Gradient of [`prefilter`] with respect to the environment's numbers.
pub fn prefilter_vjp<R: Number>(environment: &Environment<Vec<R>>, operator: &Operator, grad: &LightGrad<R>) -> Vec<R> {
    let unpad = |(map, level): (&[Vec3<R>], &specula_core::prefilter::Level)| {
        let mut texels = vec![Vec3::zero(R::of(0.0)); FACE_COUNT * level.resolution * level.resolution];
        for (index, apron) in aprons(level.resolution) {
            let share = R::of(1.0 / apron.count as f64);
            for &texel in &apron.texels[..apron.count] {
                texels[texel] = texels[texel].add_scaled(share, map[index]);
            }
        }
        texels
    };
    let maps = maps_of(&operator.levels);
    let grads: Vec<_> = texels_of_maps(&maps, &grad.texels).zip(operator.levels.as_slice()).map(unpad).collect();
    if environment.is_network() {
        return network_levels_vjp(environment, operator, &grads);
    }
    let base = operator.apply_transposed(&grads);
    let radiance = radiance(environment);
    let components =
        base.iter().zip(&radiance).flat_map(|(grad, radiance)| grad.to_array().into_iter().zip(radiance.to_array()));
    components.map(|(grad, radiance)| radiance_vjp(environment.activation, radiance, grad)).collect()
}

/// Prefiltered radiance along a direction.
pub fn look_up<R: Number>(light: &Light<R>, direction: Vec3<R>, roughness: R) -> Vec3<R> {
    light.view().radiance(direction, roughness)
}

#[cfg(test)]
mod tests {
    use super::*;
    use specula_core::double::Double;

    /// A few roundings of `f64`.
    const ROUNDING: f64 = 1e-12;

    #[test]
    fn rows_sum_to_one() {
        let operator = Operator::new(16);
        for row in operator.rows.iter().flatten() {
            let sum: f64 = row.iter().map(|(_, weight)| weight).sum();
            assert!((sum - 1.0).abs() < ROUNDING, "weights sum to {sum}");
        }
        let whole = operator.apply(&vec![Vec3::splat(Double(2.0)); FACE_COUNT * 16 * 16]);
        assert_eq!(whole.len(), operator.levels.as_slice().len(), "every level is there");
    }

    #[test]
    fn finer_rows_have_more_weights_of_the_same_sum() {
        let [coarse, fine] = [1, 2].map(|fineness| Operator::finer(16, fineness));
        let count = |operator: &Operator| operator.rows.iter().flatten().map(Vec::len).sum::<usize>();
        assert!(count(&fine) > count(&coarse), "{} and {} weights", count(&fine), count(&coarse));
        for row in fine.rows.iter().flatten() {
            let sum: f64 = row.iter().map(|(_, weight)| weight).sum();
            assert!((sum - 1.0).abs() < ROUNDING, "weights sum to {sum}");
        }
    }
}
