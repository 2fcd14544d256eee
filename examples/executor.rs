//! An executor of one's own: every stage of a picture as a plain loop over core's formulas, without
//! tiles, threads or vectors. `executor` prints the shape of a cloud.
//!
//! It has the required methods of [`Renderer`] only. `specula_conformance::renderer_tests!` at the
//! end tests all that a renderer must do.

use core::convert::Infallible;
use specula_core::{
    attributes::{AttributePlanes, GaussianShading, LightSample, StoredGaussian},
    bin,
    blend::{self, Composite, PixelState},
    camera::Camera,
    cubemap::bilinear,
    environment::radiance,
    executor::{BufferLength, Feature, Renderer, Unsupported},
    light_frame::Turned,
    light_view::{LightLookup, LightView, TexelMap},
    pixel_light::{BlendedPixel, LightLookups, PixelRays, PixelShading},
    prefilter::{LevelRange, PrefilterScheme},
    project,
    rules::{Channels, RenderRules, channel},
    scene::{Environment, Gaussians, Image},
    splat::{Splat, Splat2d},
    split_sum,
    vector::{Vec3, vec3},
};
use specula_prefilter::{Operator, sparse::Sparse};
use std::sync::Arc;

/// Executor of plain loops in `f32`.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Naive;

/// Error of the executor.
#[derive(Clone, Copy, Debug, thiserror::Error, PartialEq, Eq)]
pub(crate) enum NaiveError {
    /// A buffer has another length.
    #[error(transparent)]
    BufferLength(#[from] BufferLength),
    /// A result is not computed.
    #[error(transparent)]
    Unsupported(#[from] Unsupported),
    /// A light of this resolution cannot be filtered.
    #[error("a light of resolution {0} cannot be filtered; use a power of two from 4")]
    LightResolution(usize),
}

/// Filtered light.
#[derive(Clone, Debug)]
pub(crate) struct Light {
    /// Filter, with its levels.
    pub(crate) operator: Arc<Operator>,
    /// Texels of all levels, with aprons.
    pub(crate) texels: Vec<Vec3<f32>>,
}

impl Light {
    fn view(&self) -> LightView<'_, f32> {
        LightView { levels: self.operator.levels(), maps: self.operator.maps(), texels: &self.texels }
    }
}

/// Channels of each Gaussian.
#[derive(Clone, Debug)]
pub(crate) struct Colors {
    /// Blended channels.
    pub(crate) channels: Channels,
    /// Those of each Gaussian.
    pub(crate) values: Vec<Vec<f32>>,
}

/// Rows of a sparse matrix times a vector.
fn apply(matrix: &Sparse, columns: &[Vec3<f32>], rows: &mut [Vec3<f32>]) {
    for (row, sum) in rows.iter_mut().enumerate() {
        let weights = matrix.starts[row]..matrix.starts[row + 1];
        let zero = Vec3::zero(0.0);
        *sum = weights.fold(zero, |sum, k| sum.add_scaled(matrix.weights[k], columns[matrix.columns[k] as usize]));
    }
}

/// Pixel of a frame.
struct FramePixel<'a> {
    frame: &'a Image<Vec<f32>>,
    index: usize,
}

impl BlendedPixel<f32> for FramePixel<'_> {
    fn channel(&self, channel: usize) -> f32 {
        let blended = Channels::of_count(self.frame.channels - 1).index_of(channel);
        blended.map_or(0.0, |plane| self.frame.values[plane * self.frame.pixel_count() + self.index])
    }
    fn transmittance(&self) -> f32 {
        self.frame.values[(self.frame.channels - 1) * self.frame.pixel_count() + self.index]
    }
}

impl LightLookups<f32> for &Light {
    type Lookup = LightLookup<f32, TexelMap>;

    fn look_up(&self, direction: Vec3<f32>, roughness: f32) -> Self::Lookup {
        self.view().look_up(direction, roughness)
    }
    fn look_up_irradiance(&self, normal: Vec3<f32>) -> Self::Lookup {
        self.view().look_up_irradiance(normal)
    }
    fn radiance(&self, lookup: &Self::Lookup) -> Vec3<f32> {
        lookup.radiance()
    }
    fn split_sum(&self, n_dot_v: f32, roughness: f32) -> [f32; 2] {
        let (across, down) = (split_sum::table_position(n_dot_v), split_sum::table_position(roughness));
        let entry = |right: usize, lower: usize| {
            let row = (down.texel as usize + lower) * split_sum::RESOLUTION;
            let [scale, bias] = specula_prefilter::SPLIT_SUM[row + across.texel as usize + right];
            vec3(scale, bias, 0.0)
        };
        let sums = bilinear([entry(0, 0), entry(1, 0), entry(0, 1), entry(1, 1)], across.share, down.share);
        [sums.x, sums.y]
    }
}

impl Renderer for Naive {
    type Array = Vec<f32>;
    type Light = Light;
    /// It has none.
    type NearField = Infallible;
    type Splats = Vec<Splat<f32>>;
    type Colors = Colors;
    /// Drawn splats, front to back: one tile, the picture.
    type Tiles = Vec<usize>;
    type Frame = Image<Vec<f32>>;
    type Error = NaiveError;

    fn upload(&mut self, values: &[f32]) -> Result<Vec<f32>, NaiveError> {
        Ok(values.to_vec())
    }

    fn download(&mut self, array: &Vec<f32>, values: &mut [f32]) -> Result<(), NaiveError> {
        BufferLength::check(array.len(), values)?;
        values.copy_from_slice(array);
        Ok(())
    }

    fn read_frame(&mut self, frame: &Image<Vec<f32>>, values: &mut [f32]) -> Result<(), NaiveError> {
        self.download(&frame.values, values)
    }

    fn prefilter(
        &mut self,
        environment: &Environment<Vec<f32>>,
        scheme: PrefilterScheme,
        levels: LevelRange,
    ) -> Result<Light, NaiveError> {
        if environment.is_network() {
            return Err(Unsupported::feature(Feature::LightNetworks).into());
        }
        if scheme == PrefilterScheme::Official {
            return Err(Unsupported::feature(Feature::OfficialPrefilter).into());
        }
        if !scheme.takes(environment.resolution) {
            return Err(NaiveError::LightResolution(environment.resolution));
        }
        let operator = Operator::shared(scheme, environment.resolution, levels);
        // The base, the pyramid of its means, and the filtered texels.
        let mut nodes = vec![Vec3::zero(0.0); operator.node_count() + operator.row_count()];
        for (node, rgb) in nodes.iter_mut().zip(environment.values.as_chunks::<3>().0) {
            let [r, g, b] = rgb.map(|number| radiance(environment.activation, number));
            *node = vec3(r, g, b);
        }
        let (pyramid, rows) = nodes.split_at_mut(operator.node_count());
        for ([fine, coarse], reduction) in operator.reductions() {
            let (below, above) = pyramid.split_at_mut(coarse);
            apply(&reduction.forward, &below[fine..], &mut above[..reduction.forward.row_count()]);
        }
        let mut taps = Vec::new();
        for (row, sum) in rows.iter_mut().enumerate() {
            operator.kept_row(row, &mut taps);
            for (node, weight) in &taps {
                *sum = sum.add_scaled(*weight as f32, pyramid[*node as usize]);
            }
        }
        let mut texels = vec![Vec3::zero(0.0); operator.padded_count()];
        apply(&operator.aprons().forward, &nodes, &mut texels);
        Ok(Light { operator, texels })
    }

    fn project(&mut self, gaussians: &Gaussians<Vec<f32>>, camera: &Camera) -> Result<Self::Splats, NaiveError> {
        let camera = camera.lift(0.0_f32);
        let splat = |index: usize| {
            let planes = StoredGaussian { gaussians, index };
            project::project(&AttributePlanes::<f32>::shape(&planes, gaussians.layout), &camera)
        };
        Ok((0..gaussians.count).map(splat).collect())
    }

    fn shade(
        &mut self,
        gaussians: &Gaussians<Vec<f32>>,
        camera: &Camera,
        splats: &mut Self::Splats,
        light: Option<&Light>,
        rules: &RenderRules,
    ) -> Result<Colors, NaiveError> {
        let shading = GaussianShading { layout: gaussians.layout, rules: *rules };
        let light = light.filter(|_| shading.looks_light_up());
        let camera = camera.lift(0.0_f32);
        let mut values = Vec::with_capacity(gaussians.count);
        for (index, splat) in splats.iter_mut().enumerate() {
            let planes = StoredGaussian { gaussians, index };
            let (channels, is_finite) = if shading.reads_surface() {
                let shaded = shading.shaded(&planes, camera.position);
                let mut sample = LightSample::none(0.0);
                if let Some(light) = light {
                    sample.specular = light
                        .view()
                        .radiance(camera.light.to_light(shaded.surface.reflection_dir), shaded.surface.roughness);
                }
                (shading.surface_channels(&shaded, &shaded.terms(&sample), &camera), shaded.is_finite())
            } else {
                shading.color_channels(&planes, &camera)
            };
            if !is_finite {
                // Behind the eye, where nothing is drawn.
                splat.depth = -1.0;
            }
            let blended = (0..channels.0.len()).filter(|layer| shading.channels().contain(*layer));
            values.push(blended.map(|layer| channels.0[layer]).collect());
        }
        Ok(Colors { channels: shading.channels(), values })
    }

    fn bin(&mut self, splats: &Self::Splats, _: &Camera) -> Result<Vec<usize>, NaiveError> {
        let mut order: Vec<usize> = (0..splats.len()).filter(|k| bin::footprint(&splats[*k]).reach > 0.0).collect();
        order.sort_by(|a, b| splats[*a].depth.total_cmp(&splats[*b].depth));
        Ok(order)
    }

    fn blend(
        &mut self,
        splats: &Self::Splats,
        colors: &Colors,
        tiles: &Vec<usize>,
        camera: &Camera,
    ) -> Result<Self::Frame, NaiveError> {
        let (width, height, channels) = (camera.width as usize, camera.height as usize, colors.channels.count());
        let size = width * height;
        let mut values = vec![0.0; channels * size];
        let mut states = vec![PixelState::open(1.0); size];
        for &k in tiles {
            let splat = &splats[k];
            let splat2d = Splat2d::new(splat.mean2d, splat.root_conic, splat.opacity.log2());
            let reach = bin::half_extent(splat, bin::footprint(splat).reach);
            // Pixels of the box around the ellipse, and one more on each side.
            let [columns, rows] = [(0, width), (1, height)].map(|(axis, len)| {
                let edge = |x: f32| x.clamp(0.0, len as f32) as usize;
                edge(splat.mean2d[axis] - reach[axis] - 2.0)..edge(splat.mean2d[axis] + reach[axis] + 2.0)
            });
            for (column, row) in rows.flat_map(|row| columns.clone().map(move |column| (column, row))) {
                let [dx, dy] = [column as f32 + 0.5 - splat.mean2d[0], row as f32 + 0.5 - splat.mean2d[1]];
                let pixel = row * width + column;
                let alpha = blend::alpha(blend::falloff(&splat2d, dx, dy).log2_strength);
                let Composite { weight, behind } = blend::step(alpha, states[pixel]);
                states[pixel] = behind;
                for (channel, number) in colors.values[k].iter().enumerate() {
                    values[channel * size + pixel] += weight * number;
                }
            }
        }
        values.extend(states.iter().map(|state| state.final_transmittance));
        Ok(Image { width, height, channels: channels + 1, values })
    }

    fn shade_pixels(
        &mut self,
        surface: Self::Frame,
        light: Option<&Light>,
        camera: &Camera,
        rules: &RenderRules,
    ) -> Result<Self::Frame, NaiveError> {
        let shading = PixelShading::new(rules, Channels::of_count(surface.channels - 1));
        let (size, eye) = (surface.pixel_count(), camera.lift(0.0_f32));
        let mut values = surface.values.clone();
        for index in 0..size {
            let blended = FramePixel { frame: &surface, index };
            let [column, row] = [index % surface.width, index / surface.width].map(|k| k as f32 + 0.5);
            let rays = PixelRays { reflection: None, has_second: true, direct: None };
            let shaded = match light {
                Some(lookups) => {
                    let light = Turned { lookups, frame: eye.light };
                    shading.shaded(&blended, eye.view_dir(column, row), &rays, &light)
                }
                None => shading.unlit(&blended),
            };
            let layers =
                [(channel::COLOR, shaded.color), (channel::SPECULAR, shaded.specular), (channel::LIGHT, shaded.light)];
            for (first, layer) in layers {
                for (k, number) in layer.to_array().into_iter().enumerate() {
                    if let Some(plane) = shading.channels.index_of(first + k) {
                        values[plane * size + index] = number;
                    }
                }
            }
        }
        Ok(Image { values, ..surface })
    }
}

fn main() -> Result<(), NaiveError> {
    use specula_core::{pipeline::render, scene::Layout, shade::ShadingRules};
    use specula_oracle::scenes::{camera, random_cloud};

    let camera = camera(64, 32);
    let rules = RenderRules::full(ShadingRules::PAPER, PrefilterScheme::Exact, Channels::Color);
    let frame = render(&mut Naive, &random_cloud(80, Layout::radiance(1), 1), None, &camera, &rules)?;
    for row in frame.values[3 * frame.pixel_count()..].chunks(frame.width) {
        println!("{}", row.iter().map(|passed| if *passed < 0.5 { '#' } else { '.' }).collect::<String>());
    }
    Ok(())
}

#[cfg(test)]
specula_conformance::renderer_tests!(|| Some(Naive));
