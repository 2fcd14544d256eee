#!/usr/bin/env python3
"""Writes LPIPS (Zhang et al. 2018) as an ONNX file for `specula eval --lpips FILE`.

  pip install torch torchvision lpips onnx
  scripts/lpips-onnx.py lpips-vgg.onnx                    what tables of Gaussian splatting have
  scripts/lpips-onnx.py lpips-alex.onnx --net alex
  scripts/lpips-onnx.py lpips.onnx --inputs=-1..1         what the network was made for

The network and its weights are those of the reference package `lpips`. It was made for colours from -1 to 1. The field's
tables are of pictures from 0 to 1 that go in as they are, which gives other numbers: that is `--inputs 0..1`, the default.
With `-1..1` the file doubles what goes in and subtracts one. The file says which it is, and specula writes it beside its
results.

`--test FOLDER` writes what the tests need instead: the same networks with random weights and a 32nd of the channels, two
pictures, and what the package makes of them.
"""

import argparse
import pathlib
import tempfile
from importlib.metadata import version

import lpips
import numpy as np
import onnx
import torch

# Channels of the networks of the tests are divided by this.
NARROWER = 32
TEST_SIZE = (43, 38)
TEST_NETWORKS = [("vgg", "0..1"), ("alex", "-1..1")]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("output", metavar="FILE.onnx", nargs="?", type=pathlib.Path)
    parser.add_argument("--net", choices=["vgg", "alex", "squeeze"], default="vgg")
    parser.add_argument("--inputs", choices=["0..1", "-1..1"], default="0..1")
    parser.add_argument("--test", metavar="FOLDER", type=pathlib.Path)
    args = parser.parse_args()
    if args.test:
        write_tests(args.test)
    elif args.output:
        write(args.output, Distance(lpips.LPIPS(net=args.net, verbose=False), args.inputs), args.net)
    else:
        parser.error("say where to write it: FILE.onnx")


class Distance(torch.nn.Module):
    """Two pictures from 0 to 1 in, one number out."""

    def __init__(self, model, inputs):
        super().__init__()
        self.model = model
        self.inputs = inputs
        # For good: the exporter puts back what it finds here.
        self.eval()

    def forward(self, one, other):
        return self.model(one, other, normalize=self.inputs == "-1..1").reshape(1)


def write(path, network, name):
    words = f"{name}, lpips {version('lpips')}, inputs {network.inputs}"
    free = {2: "height", 3: "width"}
    with tempfile.NamedTemporaryFile(suffix=".onnx") as exported:
        torch.onnx.export(
            network,
            (torch.rand(1, 3, 64, 48), torch.rand(1, 3, 64, 48)),
            exported.name,
            dynamo=False,
            opset_version=17,
            input_names=["one", "other"],
            output_names=["distance"],
            dynamic_axes={"one": free, "other": free},
        )
        model = onnx.load(exported.name)
    onnx.helper.set_model_props(model, {"network": words, "check": str(check_of(network))})
    # Where in its sources a layer was made is of no use, and half of a small file.
    for node in model.graph.node:
        node.ClearField("doc_string")
    onnx.save(model, path)
    print(f"{path}: {words}, {sum(p.numel() for p in network.parameters())} numbers")


def check_of(network):
    """The distance of two pictures that whoever reads the file can make too, so that they see whether they run it right.
    Their odd sizes leave something over at the edges of windows."""
    column, row, channel = (np.arange(67), np.arange(51)[:, None], np.arange(3)[:, None, None])
    one = (7 * column + 13 * row + 29 * channel) % 64 / 63
    other = (11 * column + 5 * row + 17 * channel) % 64 / 63
    return distance_of(network, one, other)[0]


def distance_of(network, one, other):
    with torch.no_grad():
        return network(*(torch.tensor(image, dtype=torch.float32)[None] for image in (one, other))).numpy()


def write_tests(folder):
    one, other = test_pictures()
    known = {"one": one, "other": other}
    for net, inputs in TEST_NETWORKS:
        torch.manual_seed(0)
        model = lpips.LPIPS(net=net, pretrained=False, pnet_rand=True, verbose=False)
        narrow(model)
        network = Distance(model, inputs)
        write(folder / f"lpips-{net}.onnx", network, f"{net} with random weights")
        known[net] = distance_of(network, one, other)
    from safetensors.numpy import save_file

    save_file(known, folder / "lpips-known.safetensors")


def narrow(model):
    """The same layers with a fraction of the channels and random weights."""
    for part in (getattr(model.net, f"slice{k + 1}") for k in range(model.L)):
        for name, layer in part.named_children():
            if isinstance(layer, torch.nn.Conv2d):
                into = 3 if layer.in_channels == 3 else layer.in_channels // NARROWER
                out = layer.out_channels // NARROWER
                setattr(part, name, torch.nn.Conv2d(into, out, layer.kernel_size, layer.stride, layer.padding))
    for k, channels in enumerate(model.chns):
        weights = torch.rand(1, channels // NARROWER, 1, 1)
        model.lins[k].model[-1].weight = torch.nn.Parameter(weights)


def test_pictures():
    rows, columns = TEST_SIZE
    y, x = np.mgrid[:rows, :columns] / 16.0
    one = np.stack([0.5 + 0.5 * np.sin(3 * x + c) * np.cos(2 * y) for c in range(3)]).astype(np.float32)
    noise = np.random.default_rng(0).uniform(-0.1, 0.1, one.shape)
    return one, np.clip(np.roll(one, 2, axis=2) + noise, 0, 1).astype(np.float32)


main()
