#!/usr/bin/env python3
"""Writes the weights of LPIPS (Zhang et al. 2018) for `specula eval --lpips FILE`.

  pip install torch torchvision lpips numpy
  scripts/lpips-weights.py lpips-vgg.safetensors                    what tables of Gaussian splatting have
  scripts/lpips-weights.py lpips-alex.safetensors --net alex
  scripts/lpips-weights.py lpips.safetensors --inputs=-1..1         what the network was made for

The weights are those of the reference package `lpips`. It was made for colours from -1 to 1. The field's tables are of
pictures from 0 to 1 that go in as they are, which gives other numbers: that is `--inputs 0..1`, the default. The file says
which it is, and specula writes it beside its results.

`--test` writes the little network of the tests instead: the same layers with random weights and a 32nd of the channels,
two pictures, and what the package makes of them.
"""

import argparse
import json
import struct
import sys

import lpips
import numpy as np
import torch

# Channels of the network of the tests are divided by this.
NARROWER = 32
TEST_SIZE = (43, 38)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("output", metavar="FILE.safetensors")
    parser.add_argument("--net", choices=["vgg", "alex"], default="vgg")
    parser.add_argument("--inputs", choices=["0..1", "-1..1"], default="0..1")
    parser.add_argument("--test", action="store_true")
    args = parser.parse_args()
    if args.test:
        torch.manual_seed(0)
        model = lpips.LPIPS(net=args.net, pretrained=False, pnet_rand=True, verbose=False).eval()
        narrow(model)
    else:
        model = lpips.LPIPS(net=args.net, verbose=False).eval()
    tensors, layers = weights_of(model)
    network = f"{args.net}{', random weights' if args.test else ''}, lpips {version()}"
    metadata = {"network": network, "inputs": args.inputs, "layers": " ".join(layers)}
    if args.test:
        tensors |= examples(model)
    write(args.output, tensors, metadata)
    print(f"{args.output}: {network}, inputs {args.inputs}, {sum(t.size for t in tensors.values())} numbers")


def version():
    from importlib.metadata import version as of

    return of("lpips")


def slices(model):
    """The convolutions and what is between them, up to each of the layers that are compared."""
    return [getattr(model.net, f"slice{k + 1}") for k in range(model.L)]


def weights_of(model):
    """Tensors by name, and the layers in order as words."""
    tensors = {"shift": array(model.scaling_layer.shift), "scale": array(model.scaling_layer.scale)}
    layers = []
    convolutions = 0
    for tap, part in enumerate(slices(model)):
        for layer in part:
            if isinstance(layer, torch.nn.Conv2d):
                tensors[f"conv.{convolutions}.weight"] = array(layer.weight)
                tensors[f"conv.{convolutions}.bias"] = array(layer.bias)
                convolutions += 1
                layers.append(f"conv:{layer.padding[0]}:{layer.stride[0]}")
            elif isinstance(layer, torch.nn.ReLU):
                layers.append("relu")
            elif isinstance(layer, torch.nn.MaxPool2d):
                layers.append(f"pool:{layer.kernel_size}:{layer.stride}")
            else:
                sys.exit(f"lpips-weights.py: there is a layer that specula does not know: {layer}")
        layers.append("tap")
        tensors[f"lin.{tap}"] = array(model.lins[tap].model[-1].weight)
    return tensors, layers


def array(tensor):
    return tensor.detach().numpy().astype(np.float32).reshape([n for n in tensor.shape if n != 1] or [1])


def narrow(model):
    """The same layers with a fraction of the channels and random weights."""
    for part in slices(model):
        for name, layer in part.named_children():
            if isinstance(layer, torch.nn.Conv2d):
                into = 3 if layer.in_channels == 3 else layer.in_channels // NARROWER
                out = layer.out_channels // NARROWER
                setattr(part, name, torch.nn.Conv2d(into, out, layer.kernel_size, layer.stride, layer.padding))
    for k, channels in enumerate(model.chns):
        weights = torch.rand(1, channels // NARROWER, 1, 1)
        model.lins[k].model[-1].weight = torch.nn.Parameter(weights)


def examples(model):
    """Two pictures from 0 to 1, and their distance for either range of inputs."""
    rows, columns = TEST_SIZE
    y, x = np.mgrid[:rows, :columns] / 16.0
    one = np.stack([0.5 + 0.5 * np.sin(3 * x + c) * np.cos(2 * y) for c in range(3)]).astype(np.float32)
    noise = np.random.default_rng(0).uniform(-0.1, 0.1, one.shape)
    other = np.clip(np.roll(one, 2, axis=2) + noise, 0, 1).astype(np.float32)
    tensors = {"test.one": one, "test.other": other}
    with torch.no_grad():
        for name, normalize in [("test.0..1", False), ("test.-1..1", True)]:
            distance = model(torch.tensor(one)[None], torch.tensor(other)[None], normalize=normalize)
            tensors[name] = array(distance)
    return tensors


def write(path, tensors, metadata):
    """A file of safetensors: the length of a header, the header as JSON, the numbers."""
    header, place = {"__metadata__": metadata}, 0
    for name, values in tensors.items():
        header[name] = {"dtype": "F32", "shape": list(values.shape), "data_offsets": [place, place + values.nbytes]}
        place += values.nbytes
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 8)
    with open(path, "wb") as file:
        file.write(struct.pack("<Q", len(text)) + text)
        for values in tensors.values():
            file.write(np.ascontiguousarray(values, "<f4").tobytes())


main()
