//! Meshes on their way to a textured one: aligned with normals, simplified, unwrapped, textured.

use glam::{Vec2, Vec3};
use specula_mesh::{Mesh, align::aligned, atlas::Atlas, simplify::simplified, texture::Texels};
use std::collections::BTreeMap;

/// Octahedron, every triangle divided into four some times, on the unit sphere.
fn sphere(divisions: u32) -> Mesh {
    let mut places = vec![Vec3::X, Vec3::Y, Vec3::NEG_X, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z];
    let mut triangles: Vec<[u32; 3]> = (0..4).flat_map(|k| [[k, (k + 1) % 4, 4], [(k + 1) % 4, k, 5]]).collect();
    for _ in 0..divisions {
        let mut middles = BTreeMap::new();
        let mut middle = |places: &mut Vec<Vec3>, a: u32, b: u32| {
            *middles.entry([a.min(b), a.max(b)]).or_insert_with(|| {
                places.push((places[a as usize] + places[b as usize]).normalize());
                places.len() as u32 - 1
            })
        };
        let divided = triangles.iter().flat_map(|[a, b, c]| {
            let [ab, bc, ca] = [[*a, *b], [*b, *c], [*c, *a]].map(|[a, b]| middle(&mut places, a, b));
            [[*a, ab, ca], [ab, *b, bc], [ca, bc, *c], [ab, bc, ca]]
        });
        triangles = divided.collect();
    }
    let normals: Vec<[f32; 3]> = places.iter().map(|place| place.to_array()).collect();
    Mesh { colors: vec![[0.5; 3]; places.len()], positions: normals.clone(), normals, triangles }
}

/// Flat square of n² squares, in two triangles each.
fn square(n: u32) -> Mesh {
    let positions: Vec<[f32; 3]> =
        (0..=n).flat_map(|y| (0..=n).map(move |x| [x as f32 / n as f32, y as f32 / n as f32, 0.0])).collect();
    let squares = (0..n).flat_map(|y| (0..n).map(move |x| y * (n + 1) + x));
    let triangles = squares.flat_map(|a| [[a, a + 1, a + n + 2], [a, a + n + 2, a + n + 1]]).collect();
    let count = positions.len();
    Mesh { positions, normals: vec![[0.0, 0.0, 1.0]; count], colors: vec![[0.5; 3]; count], triangles }
}

fn corners(mesh: &Mesh, triangle: &[u32; 3]) -> [Vec3; 3] {
    triangle.map(|vertex| Vec3::from(mesh.positions[vertex as usize]))
}

fn area(mesh: &Mesh) -> f32 {
    let areas = mesh.triangles.iter().map(|triangle| {
        let [a, b, c] = corners(mesh, triangle);
        0.5 * (b - a).cross(c - a).length()
    });
    areas.sum()
}

/// Number of triangles at each edge.
fn edges(mesh: &Mesh) -> BTreeMap<[u32; 2], usize> {
    let mut edges = BTreeMap::new();
    for [a, b, c] in &mesh.triangles {
        for [a, b] in [[a, b], [b, c], [c, a]] {
            *edges.entry([*a.min(b), *a.max(b)]).or_insert(0) += 1;
        }
    }
    edges
}

#[test]
fn bumps_vanish_from_a_sphere_with_known_normals() {
    /// Edges of the sphere are about 0.05 long; bumps are of a fifth of that.
    const BUMP: f32 = 0.01;
    let smooth = sphere(5);
    let mut bumpy = smooth.clone();
    for (k, position) in bumpy.positions.iter_mut().enumerate() {
        let random = (k as u32).wrapping_mul(2_654_435_761) >> 8;
        let radius = 1.0 + BUMP * (random as f32 / f32::from(1_u16 << 12) / f32::from(1_u16 << 11) - 1.0);
        *position = position.map(|x| radius * x);
    }
    let error = |mesh: &Mesh| {
        let squares = mesh.positions.iter().map(|position| (Vec3::from(*position).length() - 1.0).powi(2));
        (squares.sum::<f32>() / mesh.positions.len() as f32).sqrt()
    };
    let fair = aligned(&bumpy, &smooth.normals);
    assert!(error(&bumpy) > 0.5 * BUMP, "the test has bumps: {}", error(&bumpy));
    assert!(error(&fair) < 0.2 * error(&bumpy), "{} of {}", error(&fair), error(&bumpy));
    let turned = fair.normals.iter().zip(&smooth.normals).map(|(a, b)| Vec3::from(*a).dot(Vec3::from(*b)));
    assert!(turned.fold(1.0, f32::min) > 0.999, "normals are those of the sphere, within 3°");
    // Without known normals a smooth mesh remains as it is.
    let same = aligned(&smooth, &vec![[0.0; 3]; smooth.positions.len()]);
    assert!(error(&same) < 2e-3, "{}", error(&same));
}

#[test]
fn a_simplified_sphere_is_closed_and_round() {
    let whole = sphere(5);
    let few = simplified(whole.clone(), 500);
    assert!((490..=500).contains(&few.triangles.len()), "{}", few.triangles.len());
    assert!(edges(&few).values().all(|count| *count == 2), "every edge has two triangles");
    let largest = few.positions.iter().map(|place| (Vec3::from(*place).length() - 1.0).abs()).fold(0.0, f32::max);
    assert!(largest < 0.02, "a vertex is {largest} off the sphere");
    // 500 triangles in a sphere have 98.4 % of its area.
    assert!(area(&few) > 0.97 * area(&whole), "{} of {}", area(&few), area(&whole));
    assert!(few.normals.iter().all(|normal| (Vec3::from(*normal).length() - 1.0).abs() < 1e-4));
    assert_eq!(few, simplified(whole.clone(), 500), "the result is the same every time");
    assert_eq!(simplified(whole.clone(), whole.triangles.len()), whole, "enough triangles change nothing");
}

#[test]
fn a_simplified_square_keeps_its_outline() {
    let few = simplified(square(20), 40);
    assert!(few.triangles.len() <= 40, "{}", few.triangles.len());
    assert!((area(&few) - 1.0).abs() < 1e-3, "{}", area(&few));
    assert!(few.positions.iter().all(|place| place[2].abs() < 1e-6), "it stays flat");
}

#[test]
fn a_budget_holds_even_if_solids_vanish() {
    let mut many = sphere(1);
    let one = many.clone();
    for k in 1..9 {
        let first = many.positions.len() as u32;
        many.positions.extend(one.positions.iter().map(|[x, y, z]| [x + 3.0 * k as f32, *y, *z]));
        many.normals.extend(&one.normals);
        many.colors.extend(&one.colors);
        many.triangles.extend(one.triangles.iter().map(|triangle| triangle.map(|vertex| vertex + first)));
    }
    let few = simplified(many.clone(), 100);
    assert!(few.triangles.len() <= 100 && edges(&few).values().all(|count| *count == 2), "nine closed solids");
    assert!(simplified(many, 20).triangles.len() <= 20, "fewer than nine solids have");
}

/// Places of a triangle in a texture, in texels.
fn places(atlas: &Atlas, triangle: &[u32; 3]) -> [Vec2; 3] {
    triangle.map(|vertex| Vec2::from(atlas.uvs[vertex as usize]) * atlas.size as f32)
}

#[test]
fn charts_lie_in_the_texture_and_do_not_overlap() {
    /// Distance from edges within which a texel may belong to both of their triangles, in texels.
    const EDGE: f32 = 0.01;
    let mesh = simplified(sphere(5), 1000);
    let atlas = Atlas::new(&mesh, 256).unwrap();
    assert_eq!(atlas, Atlas::new(&mesh, 256).unwrap(), "the atlas is the same every time");
    assert!(atlas.uvs.as_flattened().iter().all(|x| (0.0..=1.0).contains(x)));
    assert_eq!(atlas.mesh.triangles.len(), mesh.triangles.len());
    let mut owners = vec![0; 256 * 256];
    let mut covered = 0.0;
    for triangle in &atlas.mesh.triangles {
        let [a, b, c] = places(&atlas, triangle);
        let area = (b - a).perp_dot(c - a);
        assert!(area < 0.0, "where v points down, triangles are counterclockwise");
        covered -= 0.5 * area;
        for (texel, owner) in owners.iter_mut().enumerate() {
            let centre = Vec2::new((texel % 256) as f32 + 0.5, (texel / 256) as f32 + 0.5);
            let inside = |[p, q]: [Vec2; 2]| (q - p).perp_dot(centre - p) < -EDGE * (q - p).length();
            *owner += u32::from([[a, b], [b, c], [c, a]].into_iter().all(inside));
        }
    }
    assert!(owners.iter().all(|owner| *owner <= 1), "a texel is part of two triangles");
    assert!(covered > 0.4 * 256.0 * 256.0, "{covered} texels are used");
}

#[test]
fn tangents_follow_the_texture() {
    let atlas = Atlas::new(&simplified(sphere(4), 800), 256).unwrap();
    for triangle in &atlas.mesh.triangles {
        let [a, b, c] = corners(&atlas.mesh, triangle);
        let [p, q, r] = places(&atlas, triangle);
        // Derivatives of the position along u and along −v.
        let area = (q - p).perp_dot(r - p);
        let along_u = ((b - a) * (r - p).y - (c - a) * (q - p).y) / area;
        let against_v = ((b - a) * (r - p).x - (c - a) * (q - p).x) / area;
        for vertex in triangle {
            let normal = Vec3::from(atlas.mesh.normals[*vertex as usize]);
            let [x, y, z, w] = atlas.tangents[*vertex as usize];
            let tangent = Vec3::new(x, y, z);
            assert!(w == 1.0 && (tangent.length() - 1.0).abs() < 1e-5 && tangent.dot(normal).abs() < 1e-5);
            let cosines = [along_u.normalize().dot(tangent), against_v.normalize().dot(normal.cross(tangent))];
            assert!(cosines.iter().all(|cosine| *cosine > 0.7), "{cosines:?}");
        }
    }
}

#[test]
fn a_texture_that_is_too_small_is_refused() {
    let error = Atlas::new(&sphere(6), 8).unwrap_err();
    assert!(error.to_string().contains("8 × 8"), "{error}");
}

#[test]
fn texels_lie_on_the_surface_and_the_others_are_filled() {
    let mesh = simplified(sphere(5), 2000);
    let texels = Texels::new(&Atlas::new(&mesh, 128).unwrap());
    assert!(texels.indices.len() > 128 * 128 / 3 && texels.indices.is_sorted());
    for (texel, (position, normal)) in texels.positions.iter().zip(&texels.normals).enumerate() {
        let [position, normal] = [position, normal].map(|vector| Vec3::from(*vector));
        assert!((position.length() - 1.0).abs() < 0.01 && normal.dot(position) > 0.99, "{position}");
        let straight = texels.in_tangent_space(texel, normal);
        assert!(straight.distance(Vec3::Z) < 1e-3, "the surface's own normal is the third axis, not {straight}");
        assert!(texels.in_tangent_space(texel, -normal).z > 0.0, "normals are on the front");
    }
    let values: Vec<_> = texels.positions.iter().map(|[x, ..]| (*x > 0.0).then_some([2.0 + x])).collect();
    let filled = texels.filled(&values);
    for (index, value) in texels.indices.iter().zip(&values).filter_map(|(index, value)| Some((index, (*value)?))) {
        assert_eq!(filled[*index as usize], value, "known texels remain");
    }
    assert!(filled.iter().all(|[value]| (2.0..=3.01).contains(value)), "others have means of known ones");
    let none = texels.filled(&vec![None; texels.indices.len()]);
    assert!(none.iter().all(|value| *value == [0.0]), "nothing is known");
}
