//! Exported files, opened by programs of others in Python: plyfile, and OpenUSD's own reader. Left
//! out with a sentence where Python lacks them.

use crate::{
    export::{Ball, soft},
    python::{has_python, python},
    textured,
};
use assert_cmd::Command;
use core::time::Duration;
use std::path::Path;

/// Time of a script; a machine that compiles at the same time needs some seconds.
const MOST: Duration = Duration::from_secs(120);

/// Runs a script with a file as its argument; its assertions hold.
fn checks(script: &str, file: &Path) {
    let mut command = Command::from_std(python());
    command.timeout(MOST).args(["-c", script]).arg(file).assert().success();
}

#[test]
fn plyfile_reads_materials() {
    if !has_python("plyfile") {
        return;
    }
    let ball = Ball::under(soft);
    let (path, _) = ball.export("ball.ply", &["--bake", "materials", "--no-error"]);
    checks(
        r#"
import sys, numpy as np
from plyfile import PlyData
ply = PlyData.read(sys.argv[1])
assert not ply.text and ply.byte_order == "<" and not ply.comments
v = ply["vertex"]
assert len(v) == 2500
p, n = (np.stack([v[k] for k in names], 1) for names in (("x", "y", "z"), ("nx", "ny", "nz")))
assert np.abs(p - n).max() < 1e-5
srgb = 0.5 + 0.28209479 * np.stack([v[f"f_dc_{k}"] for k in range(3)], 1)
linear = ((srgb + 0.055) / 1.055) ** 2.4
assert np.abs(linear - [0.7, 0.5, 0.2]).max() < 1e-4
for metallic, roughness in (("metallicFactor", "roughnessFactor"), ("pm", "pr")):
    assert np.abs(v[metallic] - 0.25).max() < 1e-5 and np.abs(v[roughness] - 0.3).max() < 1e-5
assert np.abs(np.sort(v["opacity"]) - (3 + 0.001 * np.arange(2500))).max() < 1e-4
"#,
        &path,
    );
}

#[test]
fn openusd_reads_scenes_materials_and_light() {
    if !has_python("pxr.UsdValidation") {
        return;
    }
    let ball = Ball::under(soft);
    for (name, words) in [
        ("ball.usda", &["--bake", "materials", "--no-error"][..]),
        ("ball.usdz", &["--bake", "materials", "--no-error"]),
        ("upright.usdz", &["--sh-degree", "2", "--no-error", "--upright"]),
    ] {
        let (path, _) = ball.export(name, words);
        checks(
            r#"
import sys, math
from pxr import Ar, Gf, Usd, UsdGeom, UsdLux, UsdValidation
path = sys.argv[1]
stage = Usd.Stage.Open(path)
is_upright = "upright" in path
degree = 2 if is_upright else 0
assert stage.GetDefaultPrim().GetPath() == "/Scene"
assert UsdGeom.GetStageMetersPerUnit(stage) == 1
assert UsdGeom.GetStageUpAxis(stage) == "Y"
assert len(UsdGeom.Xformable(stage.GetDefaultPrim()).GetOrderedXformOps()) == 3
splats = stage.GetPrimAtPath("/Scene/Gaussians")
assert splats.GetTypeName() == "ParticleField3DGaussianSplat" and splats.IsA("Gprim")
of = lambda name: splats.GetAttribute(name).Get()
known = splats.GetPrimDefinition()
for name in ("positions", "orientations", "scales", "opacities", "radiance:sphericalHarmonicsCoefficients"):
    assert splats.GetAttribute(name).GetTypeName() == known.GetSchemaAttributeSpec(name).typeName, name
assert len(of("positions")) == len(of("orientations")) == len(of("scales")) == len(of("opacities")) == 2500
assert of("radiance:sphericalHarmonicsDegree") == degree
assert len(of("radiance:sphericalHarmonicsCoefficients")) == 2500 * (degree + 1) ** 2
assert of("colorSpace:name") == Gf.ColorSpaceNames.SRGBRec709
assert max(abs(q.GetLength() - 1) for q in of("orientations")) < 1e-5
opacities = sorted(of("opacities"))
assert max(abs(o - 1 / (1 + math.exp(-3 - 0.001 * k))) for k, o in enumerate(opacities)) < 1e-5
for scale in of("scales"):
    assert max(abs(a - b) for a, b in zip(sorted(scale), (0.004, 0.065, 0.07))) < 1e-5
primvars = UsdGeom.PrimvarsAPI(splats)
for name, kind in (("normals", "normal3f[]"), ("albedo", "color3f[]"), ("roughness", "float[]"), ("metallic", "float[]")):
    primvar = primvars.GetPrimvar(name)
    assert primvar.GetTypeName() == kind and primvar.GetInterpolation() == "vertex", name
    assert len(primvar.Get()) == 2500, name
assert primvars.GetPrimvar("albedo").GetAttr().GetColorSpace() == Gf.ColorSpaceNames.LinearRec709
assert all((n - p).GetLength() < 1e-5 for n, p in zip(primvars.GetPrimvar("normals").Get(), of("positions")))
assert all((Gf.Vec3f(0.7, 0.5, 0.2) - a).GetLength() < 1e-5 for a in primvars.GetPrimvar("albedo").Get())
assert all(abs(r - 0.3) < 1e-5 for r in primvars.GetPrimvar("roughness").Get())
assert all(abs(m - 0.25) < 1e-5 for m in primvars.GetPrimvar("metallic").Get())
if not is_upright:
    srgb = [1.055 * a ** (1 / 2.4) - 0.055 for a in (0.7, 0.5, 0.2)]
    first = Gf.Vec3f(*((c - 0.5) / 0.28209479 for c in srgb))
    assert all((first - c).GetLength() < 1e-4 for c in of("radiance:sphericalHarmonicsCoefficients"))
low, high = of("extent")
assert all(low[k] <= p[k] <= high[k] for p in of("positions") for k in range(3))
light = UsdLux.DomeLight(stage.GetPrimAtPath("/Scene/Light"))
assert light and light.GetTextureFormatAttr().Get() == "latlong"
texture = light.GetTextureFileAttr()
assert Ar.GetResolver().OpenAsset(Ar.ResolvedPath(texture.Get().resolvedPath)).GetSize() > 1000
assert texture.GetColorSpace() == Gf.ColorSpaceNames.LinearRec709
validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
faults = [fault.GetMessage() for fault in UsdValidation.ValidationContext(validators).Validate(stage)]
assert len(validators) > 10
assert not faults, faults
"#,
            &path,
        );
    }
}

#[test]
fn openusd_reads_meshes_as_gltf_has_them() {
    if !has_python("pxr.UsdValidation") {
        return;
    }
    let ball = textured::ball();
    textured::export(&ball, "ball.glb", &[]);
    for name in ["ball.usda", "ball.usdz"] {
        let (path, _) = textured::export(&ball, name, &[]);
        checks(
            r#"
import sys, json, struct
from array import array
from pxr import Ar, Gf, Usd, UsdGeom, UsdShade, UsdValidation
path = sys.argv[1]
glb = open(path[:-4] + "glb", "rb").read()
json_len = struct.unpack_from("<I", glb, 12)[0]
gltf, blob = json.loads(glb[20:20 + json_len]), glb[28 + json_len:]
def numbers(index, code):
    accessor = gltf["accessors"][index]
    view = gltf["bufferViews"][accessor["bufferView"]]
    return array(code, blob[view["byteOffset"]:view["byteOffset"] + view["byteLength"]])
primitive = gltf["meshes"][0]["primitives"][0]
floats = {name: numbers(index, "f") for name, index in primitive["attributes"].items()}
indices = numbers(primitive["indices"], "I")
stage = Usd.Stage.Open(path)
assert stage.GetDefaultPrim().GetPath() == "/Scene" and UsdGeom.GetStageUpAxis(stage) == "Y"
mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/Scene/Mesh"))
flat = lambda values: [x for value in values for x in value]
near = lambda ours, theirs: len(ours) == len(theirs) and all(abs(a - b) < 1e-6 for a, b in zip(ours, theirs))
assert near(flat(mesh.GetPointsAttr().Get()), floats["POSITION"])
assert near(flat(mesh.GetNormalsAttr().Get()), floats["NORMAL"]) and mesh.GetNormalsInterpolation() == "vertex"
assert list(mesh.GetFaceVertexIndicesAttr().Get()) == list(indices)
assert set(mesh.GetFaceVertexCountsAttr().Get()) == {3} and mesh.GetSubdivisionSchemeAttr().Get() == "none"
st = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("st")
flipped = [x if k % 2 == 0 else 1 - x for k, x in enumerate(floats["TEXCOORD_0"])]
assert st.GetInterpolation() == "vertex" and near(flat(st.Get()), flipped)
material, _ = UsdShade.MaterialBindingAPI(mesh).ComputeBoundMaterial()
surface, _, _ = material.ComputeSurfaceSource()
assert surface.GetIdAttr().Get() == "UsdPreviewSurface"
for name, file, output, space in (
    ("diffuseColor", "base_color", "rgb", "sRGB"),
    ("roughness", "roughness_metallic", "g", "raw"),
    ("metallic", "roughness_metallic", "b", "raw"),
    ("normal", "normals", "rgb", "raw"),
):
    source = surface.GetInput(name).GetConnectedSources()[0][0]
    texture = UsdShade.Shader(source.source.GetPrim())
    assert texture.GetIdAttr().Get() == "UsdUVTexture" and source.sourceName == output, name
    asset = texture.GetInput("file").Get()
    assert asset.path.endswith(file + ".png") and texture.GetInput("sourceColorSpace").Get() == space, name
    assert Ar.GetResolver().OpenAsset(Ar.ResolvedPath(asset.resolvedPath)).GetSize() > 100
low, high = mesh.GetExtentAttr().Get()
assert all(low[k] <= p[k] <= high[k] for p in mesh.GetPointsAttr().Get() for k in range(3))
validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
faults = [fault.GetMessage() for fault in UsdValidation.ValidationContext(validators).Validate(stage)]
assert not faults, faults
"#,
            &path,
        );
    }
}
