//! Meshes with textures, opened by a reader that is not ours: surface, textures and tangents are
//! those of the scene.

use crate::{
    export::{Ball, soft},
    tiny::specula,
};
use glam::{Mat3, Quat, Vec2, Vec3};
use gltf::{Gltf, khr_lights_punctual::Kind};
use image::RgbImage;
use specula_core::{
    activation::logit,
    color::srgb_from_linear,
    scene::{ALBEDO, MEAN, METALNESS, ROUGHNESS},
};
use std::{
    fs,
    path::{Path, PathBuf},
};

/// Half a step of 8 bits, and what the mean over pixels at silhouettes differs.
const TEXEL: f32 = 2.0 / 255.0;
const VOXELS: &str = "48";
const TRIANGLES: usize = 800;
const TEXELS: u32 = 128;

/// Albedo, roughness and metalness of the upper and of the lower half of the ball.
const HALVES: [([f32; 3], f32, f32); 2] = [([0.7, 0.5, 0.2], 0.3, 0.25), ([0.1, 0.3, 0.6], 0.7, 0.9)];

/// Ball of two materials.
pub(crate) fn ball() -> Ball {
    let mut ball = Ball::under(soft);
    let first = ball.gaussians.layout.physical_planes().unwrap();
    for index in 0..ball.gaussians.count {
        let (albedo, roughness, metalness) = HALVES[usize::from(ball.gaussians.get::<3>(index, MEAN)[2] < 0.0)];
        ball.gaussians.set(index, first + ALBEDO, albedo.map(logit));
        ball.gaussians.set(index, ROUGHNESS, [logit(roughness)]);
        ball.gaussians.set(index, first + METALNESS, [logit(metalness)]);
    }
    ball.save(&soft);
    ball
}

/// Textured mesh as a reader sees it.
struct Textured {
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    tangents: Vec<[f32; 4]>,
    uvs: Vec<Vec2>,
    triangles: Vec<[u32; 3]>,
    /// Base colour, roughness and metalness, normals.
    textures: [Option<RgbImage>; 3],
}

impl Textured {
    fn open(path: &Path) -> Self {
        let file = Gltf::open(path).unwrap();
        let blob = file.blob.as_deref().unwrap();
        let mesh = file.meshes().next().unwrap();
        let primitive = mesh.primitives().next().unwrap();
        let reader = primitive.reader(|_| Some(blob));
        let material = primitive.material();
        let picture = |texture: gltf::Texture<'_>| {
            let gltf::image::Source::View { view, mime_type } = texture.source().source() else { panic!("a file") };
            assert_eq!(mime_type, "image/png", "the format of a texture");
            image::load_from_memory(&blob[view.offset()..][..view.length()]).unwrap().into_rgb8()
        };
        let physical = material.pbr_metallic_roughness();
        let textures = [
            physical.base_color_texture().map(|info| picture(info.texture())),
            physical.metallic_roughness_texture().map(|info| picture(info.texture())),
            material.normal_texture().map(|info| picture(info.texture())),
        ];
        let indices: Vec<u32> = reader.read_indices().unwrap().into_u32().collect();
        Self {
            positions: reader.read_positions().unwrap().map(Vec3::from).collect(),
            normals: reader.read_normals().unwrap().map(Vec3::from).collect(),
            tangents: reader.read_tangents().map(Iterator::collect).unwrap_or_default(),
            uvs: reader.read_tex_coords(0).unwrap().into_f32().map(Vec2::from).collect(),
            triangles: indices.as_chunks().0.to_vec(),
            textures,
        }
    }

    /// Colour of a texture in the middle of a triangle.
    fn texel(&self, texture: usize, triangle: &[u32; 3]) -> Vec3 {
        let picture = self.textures[texture].as_ref().unwrap();
        let place: Vec2 = self.mean(&self.uvs, triangle) * picture.width() as f32;
        Vec3::from(picture.get_pixel(place.x as u32, place.y as u32).0.map(|byte| f32::from(byte) / 255.0))
    }

    fn mean<T: Copy + core::iter::Sum + core::ops::Div<f32, Output = T>>(&self, of: &[T], triangle: &[u32; 3]) -> T {
        triangle.iter().map(|vertex| of[*vertex as usize]).sum::<T>() / 3.0
    }
}

pub(crate) fn export(ball: &Ball, name: &str, words: &[&str]) -> (PathBuf, String) {
    let (triangles, texels) = (TRIANGLES.to_string(), TEXELS.to_string());
    let size = ["--mesh", "--voxels", VOXELS, "--triangles", &triangles, "--texture", &texels];
    ball.export(name, &[&size, words].concat())
}

#[test]
fn a_textured_mesh_has_the_materials_and_normals_of_the_gaussians() {
    let ball = ball();
    let (path, said) = export(&ball, "ball.glb", &[]);
    assert!(said.contains("triangles") && said.contains("textures of 128 × 128"), "{said}");
    let mesh = Textured::open(&path);
    assert!(mesh.triangles.len() <= TRIANGLES && mesh.triangles.len() > TRIANGLES / 2, "{}", mesh.triangles.len());
    for (k, position) in mesh.positions.iter().enumerate() {
        let [x, y, z, w] = mesh.tangents[k];
        let (normal, tangent) = (mesh.normals[k], Vec3::new(x, y, z));
        assert!((position.length() - 1.0).abs() < 0.05, "{position} is not on the ball");
        assert!(normal.dot(position.normalize()) > 0.98, "the normal {normal} at {position}");
        assert!((normal.length() - 1.0).abs() < 1e-4 && (tangent.length() - 1.0).abs() < 1e-4);
        assert!(w.abs() == 1.0 && normal.dot(tangent).abs() < 1e-4, "{normal} and {tangent} are not perpendicular");
        assert!((0.0..=1.0).contains(&mesh.uvs[k].x) && (0.0..=1.0).contains(&mesh.uvs[k].y));
    }
    for triangle in &mesh.triangles {
        let place = mesh.mean(&mesh.positions, triangle).normalize();
        let facing = mesh.mean(&mesh.normals, triangle);
        let along =
            mesh.mean(&mesh.tangents.iter().map(|[x, y, z, _]| Vec3::new(*x, *y, *z)).collect::<Vec<_>>(), triangle);
        let frame = Mat3::from_cols(along, mesh.tangents[triangle[0] as usize][3] * facing.cross(along), facing);
        let normal = (frame * (2.0 * mesh.texel(2, triangle) - 1.0)).normalize();
        assert!(normal.dot(place) > 0.99, "the normal {normal} of the texture at {place}");
        if place.z.abs() < 0.2 {
            continue;
        }
        let (albedo, roughness, metalness) = HALVES[usize::from(place.z < 0.0)];
        let [color, surface] = [0, 1].map(|texture| mesh.texel(texture, triangle));
        let expected = Vec3::from(albedo.map(srgb_from_linear));
        assert!(color.distance(expected) < 2.0 * TEXEL, "the base colour {color} at {place} is not {expected}");
        assert!((surface.y - roughness).abs() < TEXEL && (surface.z - metalness).abs() < TEXEL, "{surface} at {place}");
    }
    let (again, _) = export(&ball, "again.glb", &["--threads", "1"]);
    assert!(fs::read(&path).unwrap() == fs::read(again).unwrap(), "the same bytes every time, for any threads");
}

#[test]
fn an_upright_textured_mesh_is_placed_by_its_node() {
    let ball = ball();
    let (path, _) = export(&ball, "ball.glb", &["--upright", "--scene-up", "z"]);
    let file = Gltf::open(&path).unwrap();
    let (_, rotation, scale) = file.nodes().next().unwrap().transform().decomposed();
    // The ball's cameras are 4 away; z is up in its world.
    assert!((scale[0] - 1.0).abs() < 0.05, "{scale:?}");
    let up = Quat::from_array(rotation) * Vec3::Z;
    assert!(up.distance(Vec3::Y) < 1e-4, "{up}");
}

#[test]
fn suns_and_lamps_are_lights_of_the_file_in_the_world_of_the_mesh() {
    let ball = ball();
    let words = ["--upright", "--scene-up", "z", "--sun", "0,90,2:ff0000", "--lamp", "0,0,3,4,0.5"];
    let (path, _) = export(&ball, "lit.glb", &words);
    let file = Gltf::open(&path).unwrap();
    let lights: Vec<_> = file.nodes().filter_map(|node| Some((node.light()?, node.transform().decomposed()))).collect();
    let [(sun, (_, turn, _)), (lamp, (place, _, _))] = &lights[..] else { panic!("{} lights", lights.len()) };
    assert!(matches!(sun.kind(), Kind::Directional) && matches!(lamp.kind(), Kind::Point));
    assert!((sun.intensity() - 2.0).abs() < 1e-4 && sun.color() == [1.0, 0.0, 0.0], "{:?}", sun.color());
    let down = Quat::from_array(*turn) * -Vec3::Z;
    assert!(down.distance(-Vec3::Y) < 1e-4, "the sun in the zenith shines to {down}");
    let (ours, rotation, scale) = file.nodes().next().unwrap().transform().decomposed();
    let expected = Quat::from_array(rotation) * Vec3::new(0.0, 0.0, 3.0) * scale[0] + Vec3::from(ours);
    assert!(Vec3::from(*place).distance(expected) < 1e-4, "{place:?} is not {expected}");
    assert!((lamp.intensity() - 4.0 * scale[0] * scale[0]).abs() < 1e-3, "irradiance on the mesh is that of the scene");
}

#[test]
fn without_materials_the_base_color_is_that_of_pictures() {
    let ball = Ball::under(soft);
    let (plain, _) = ball.export("plain.ply", &["--no-error"]);
    let path = ball.tiny.path("plain.glb");
    let mut command = specula();
    command.arg("export").arg(&plain).arg("-o").arg(&path).args(["--mesh", "--voxels", VOXELS, "--texture", "64"]);
    let output = command.args(["--triangles", "0.5k", "--quiet"]).assert().success().get_output().clone();
    let said = String::from_utf8(output.stdout).unwrap();
    assert!(said.contains("contains the light") && said.contains("--relightable"), "{said}");
    let mesh = Textured::open(&path);
    let [base, surface, normals] = &mesh.textures;
    assert!(base.is_some() && surface.is_none() && normals.is_none() && mesh.tangents.is_empty());
    let json = Gltf::open(&path).unwrap();
    assert!(json.extensions_used().eq(["KHR_materials_unlit"]), "the light is not added again");
    let shown =
        mesh.triangles.iter().map(|triangle| mesh.texel(0, triangle)).sum::<Vec3>() / mesh.triangles.len() as f32;
    assert!(shown.max_element() > 0.2 && shown.min_element() < 0.95, "{shown} is the colour of the ball");
}

#[test]
fn a_stage_has_the_textures_of_the_gltf_file() {
    let ball = ball();
    let (gltf, stage) = (ball.tiny.path("ball.glb"), ball.tiny.path("ball.usda"));
    let (_, said) = export(&ball, "ball.glb", &["--sun", "0,45", "-o", stage.to_str().unwrap()]);
    assert!(said.contains("ball.usda") && said.contains("suns and lamps are only in pages and .glb meshes"), "{said}");
    let mesh = Textured::open(&gltf);
    for (name, texture) in ["base_color", "roughness_metallic", "normals"].iter().zip(&mesh.textures) {
        let beside = image::open(ball.tiny.path(&format!("ball.{name}.png"))).unwrap().into_rgb8();
        assert!(Some(&beside) == texture.as_ref(), "{name} is another picture");
    }
    let (plain, _) = ball.export("plain.ply", &["--no-error"]);
    let unlit = ball.tiny.path("plain.usda");
    let mut command = specula();
    command.arg("export").arg(&plain).arg("-o").arg(&unlit).args(["--mesh", "--voxels", VOXELS, "--texture", "64"]);
    command.args(["--triangles", "500", "--quiet"]).assert().success();
    let text = fs::read_to_string(unlit).unwrap();
    assert!(text.contains("emissiveColor.connect") && !text.contains("inputs:normal"), "colours contain the light");
}

#[test]
fn bad_sizes_are_refused() {
    let ball = Ball::under(soft);
    let refused = |name: &str, words: &[&str], expected: &str| {
        let path = ball.tiny.path(name);
        let mut command = specula();
        command.arg("export").arg(ball.model()).arg("-o").arg(&path).args(words).arg("--quiet");
        let stderr = String::from_utf8(command.assert().code(2).get_output().stderr.clone()).unwrap();
        assert!(stderr.contains(expected) && !path.exists(), "{expected:?} is not in: {stderr}");
    };
    refused("ball.glb", &["--mesh", "--triangles", "none"], "--triangles");
    refused("ball.glb", &["--mesh", "--triangles", "99"], "100 triangles or more");
    refused("ball.glb", &["--mesh", "--texture", "32"], "from 64 to 8192");
    refused("ball.glb", &["--mesh", "--texture", "9000"], "from 64 to 8192");
    refused("ball.glb", &["--mesh", "--env", "sunset"], "no effect on a mesh of materials");
    refused("ball.glb", &["--mesh", "--ground"], "apply to pages");
    refused("ball.obj", &["--sun", "0,45"], "to .glb meshes");
    refused("ball.usdz", &["--mesh", "--sun", "0,45"], "to .glb meshes");
    refused("ball.glb", &["--mesh", "--lamp", "0,0,1e10,1"], "lamp 0 has");
    refused("ball.glb", &["--triangles", "500"], "--triangles applies to meshes");
    refused("ball.obj", &["--texture", "512"], "--texture applies to .glb and .usdz meshes");
}

#[test]
fn triangles_bound_every_mesh() {
    let ball = Ball::under(soft);
    let (path, _) = ball.export("ball.obj", &["--voxels", VOXELS, "--triangles", "300"]);
    let (models, _) = tobj::load_obj(&path, &tobj::LoadOptions::default()).unwrap();
    let count = models[0].mesh.indices.len() / 3;
    assert!((250..=300).contains(&count), "{count}");
}
