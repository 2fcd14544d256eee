"""Rasterisation as a function of jax with a gradient of its own, through a callback on the host."""

import sys

try:
    import jax
    import jax.numpy as jnp
except ImportError as error:
    sys.exit(f"this example needs jax ({error}): pip install jax")

import numpy as np

import specula_gs as sg

SIZE = 48
viewmats = np.eye(4, dtype=np.float32)[None]
Ks = np.array([[[SIZE, 0, SIZE / 2], [0, SIZE, SIZE / 2], [0, 0, 1]]], np.float32)
camera = dict(viewmats=viewmats, Ks=Ks, width=SIZE, height=SIZE)
shape = jax.ShapeDtypeStruct((1, SIZE, SIZE, 3), jnp.float32)


@jax.custom_vjp
def rasterize(*gaussians):
    """Picture [1, H, W, 3] of means, quats, scales, opacities and colours."""
    return jax.pure_callback(lambda *arrays: sg.rasterization(*map(np.asarray, arrays), **camera)[0], shape, *gaussians)


def backward(gaussians, cotangent):
    """Renders once more, so that nothing but arrays is kept between the passes."""

    def on_host(cotangent, *arrays):
        *_, vjp = sg.rasterization_vjp(*map(np.asarray, arrays), **camera)
        return tuple(vjp(np.asarray(cotangent))[:5])

    shapes = tuple(jax.ShapeDtypeStruct(array.shape, array.dtype) for array in gaussians)
    return jax.pure_callback(on_host, shapes, cotangent, *gaussians)


rasterize.defvjp(lambda *gaussians: (rasterize(*gaussians), gaussians), backward)

rng = np.random.default_rng(0)
count = 300
means = np.append(rng.uniform(-0.5, 0.5, (count, 2)), np.ones((count, 1)), 1)
parameters = [
    jnp.asarray(array, jnp.float32)
    for array in (
        means,
        rng.normal(size=(count, 4)),
        np.full((count, 3), 0.04),
        np.full(count, 0.5),
        np.full((count, 3), 0.5),
    )
]
target = np.tile(np.linspace(0, 1, SIZE, dtype=np.float32)[None, :, None], (SIZE, 1, 3))[None]


@jax.jit
def step(parameters):
    loss, grads = jax.value_and_grad(lambda p: jnp.mean((rasterize(*p) - target) ** 2))(parameters)
    colors = parameters[4] - 20.0 * grads[4]
    return loss, [*parameters[:4], colors]


losses = []
for _ in range(10 if "--quick" in sys.argv else 100):
    loss, parameters = step(parameters)
    losses.append(float(loss))
print(f"mean squared error {losses[0]:.4f} before, {losses[-1]:.4f} after {len(losses)} steps")
assert losses[-1] < losses[0]
