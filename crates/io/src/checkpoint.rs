//! State of an interrupted training: `checkpoint.safetensors` in the folder of a model.
//!
//! ```text
//! length of the header, 8 bytes
//! header: JSON of safetensors; "__metadata__" has one entry, "specula", which is JSON
//! gaussians, gaussians.mean, gaussians.square   f32 [blocks, planes, 16], with Adam's moments
//! grad_sum, view_count                          f32 [Gaussians]: statistics for densification
//! light, light.mean, light.square               f32 [6, resolution, resolution, 3], with a light;
//!                                               f32 [weights] where it is a network
//! light_2, light_2.mean, light_2.square, …      lights of other groups of pictures
//! near_field                                    f32 [numbers]: nodes, triangles and vertices of a
//!                                               surface that reflected rays may meet
//! exposure, exposure.mean, exposure.square      f32 [views, 3, 4], with learned exposures
//! order                                         u32 [views]: remaining views of the current pass
//! ```
//!
//! Numbers are little-endian. Memory is allocated after the size of the file has been checked
//! against the header.
//!
//! After interruption, crash or device loss, a training resumes from its last checkpoint, or from
//! its initial points. Pictures are decoded again. A checkpoint identifies its training by the text
//! of `config.toml`, by every value of the resulting settings, and by a checksum over pictures,
//! names and cameras: the first names a changed option, the second detects a program with other
//! profiles, the third another data set under the same path.

use crate::{
    budget::{CHECKPOINT_HEADER_MAX, SCENE},
    error::{Error, Result},
    json, whole_file, within,
};
use core::{fmt::Display, iter};
use safetensors::{
    Dtype,
    tensor::{Metadata, TensorInfo},
};
use serde::{Deserialize, Serialize};
use specula_core::{
    cubemap::FACE_COUNT,
    expose::Exposure,
    light_network::WEIGHT_COUNT,
    near_field::{INDEX_MAX, NearField, NearFieldError},
    scene::{BLOCK, Environment, Gaussians, Layout, RadianceActivation},
    state::{AdamMoments, ExposureState, FittedLight, SceneState, Statistics, TrainingState},
};
use std::{
    borrow::Cow,
    collections::HashMap,
    fs::File,
    io::{self, Read, Seek, SeekFrom, Write},
    path::{Path, PathBuf},
};

/// Version of the format; incremented when older programs would misread a file.
const FORMAT: u32 = 1;
/// Key of specula's entry in the metadata.
const KEY: &str = "specula";
/// Bytes of the header's length.
const LENGTH_SIZE: u64 = 8;
/// Longest training in seconds: a hundred years.
const SECONDS_MAX: f64 = 3.2e9;
/// Maximum number of gradients that a training may have skipped; half the range of the counter.
const NONFINITE_MAX: usize = usize::MAX >> 1;
/// Words converted to bytes at once.
const PIECE: usize = 1 << 16;

/// State of a training, and a description of the training.
#[derive(Clone, Debug)]
pub struct Checkpoint {
    /// State between two steps.
    pub state: TrainingState<Vec<f32>>,
    /// Description of the training.
    pub facts: Facts,
}

/// Description of a training, by which another run recognises it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Facts {
    /// Version of the program.
    pub program: String,
    /// Steps of the whole training.
    pub iterations: u32,
    /// Seconds of the steps so far.
    pub seconds: f64,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Options as the text of `config.toml`.
    pub config: String,
    /// All settings that follow from the options.
    pub settings: String,
    /// Number of training pictures.
    pub views: usize,
    /// Checksum of the views' names, cameras and pixels.
    pub pictures: String,
}

/// [`Facts`] and the counters of the state, in the order of the file.
#[derive(Serialize, Deserialize)]
struct FactsHeader {
    program: String,
    iteration: u32,
    iterations: u32,
    seconds: f64,
    psnr: Option<f64>,
    nonfinite: usize,
    seed: u64,
    config: String,
    settings: String,
    views: usize,
    pictures: String,
}

impl FactsHeader {
    fn of(Checkpoint { state, facts }: &Checkpoint) -> Self {
        let TrainingState { iteration, psnr, nonfinite, .. } = *state;
        let Facts { program, iterations, seconds, seed, config, settings, views, pictures } = facts.clone();
        Self { program, iteration, iterations, seconds, psnr, nonfinite, seed, config, settings, views, pictures }
    }

    /// Describes the first number that is out of range.
    fn fault(&self) -> Option<String> {
        let Self { iteration, iterations, seconds, psnr, nonfinite, .. } = self;
        if iteration > iterations {
            Some(format!("it is of iteration {iteration} of {iterations}"))
        } else if !(0.0..=SECONDS_MAX).contains(seconds) {
            Some(format!("its training took {seconds} seconds"))
        } else if !psnr.is_none_or(f64::is_finite) {
            Some("its PSNR is not finite".to_owned())
        } else if *nonfinite > NONFINITE_MAX {
            Some(format!("it skipped {nonfinite} gradients"))
        } else {
            None
        }
    }
}

/// Specula's entry in the metadata.
#[derive(Serialize, Deserialize)]
struct Header {
    format: u32,
    facts: FactsHeader,
    gaussians: usize,
    is_shaded: bool,
    sh_degree: Option<u8>,
    /// Whether Gaussians have physical materials.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    is_physical: bool,
    /// Whether Gaussians have both filters of Mip-Splatting.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    is_antialiased: bool,
    light: Option<LightHeader>,
    /// Number of lights like that one, for other groups of pictures.
    #[serde(default, skip_serializing_if = "json::is_default")]
    other_lights: usize,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    near_field: Option<NearFieldHeader>,
    /// Number of photographs with exposures.
    exposures: Option<usize>,
}

#[derive(Clone, Copy, Serialize, Deserialize)]
struct NearFieldHeader {
    /// Numbers of nodes, triangles and vertices.
    sizes: [usize; 3],
    offset: f32,
}

#[derive(Clone, Copy, Serialize, Deserialize)]
struct LightHeader {
    resolution: usize,
    is_exponential: bool,
    /// Whether the numbers are the weights of a network.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    is_network: bool,
}

/// Part of the header that all versions share.
#[derive(Deserialize)]
struct AnyHeader {
    format: u32,
}

/// Path of the checkpoint of a model.
pub fn path_in(folder: &Path) -> PathBuf {
    folder.join("checkpoint.safetensors")
}

/// Writes the checkpoint of a model, replacing the previous one.
///
/// # Errors
///
/// [`Error::Write`] if the file cannot be written.
pub fn write(folder: &Path, checkpoint: &Checkpoint) -> Result<()> {
    whole_file::write(&path_in(folder), |out| {
        let tensors = tensors_of(checkpoint);
        let header = header_bytes(checkpoint, &tensors)?;
        out.write_all(&(header.len() as u64).to_le_bytes())?;
        out.write_all(&header)?;
        tensors.iter().try_for_each(|tensor| write_words(out, tensor.words))
    })
}

/// A tensor to be written: name, type, shape, and numbers as 32-bit words.
struct Tensor<'a> {
    name: Cow<'static, str>,
    dtype: Dtype,
    shape: Vec<usize>,
    words: &'a [u32],
}

fn tensors_of(checkpoint: &Checkpoint) -> Vec<Tensor<'_>> {
    let TrainingState { scene, other_lights, near_field, exposures, order, .. } = &checkpoint.state;
    let SceneState { gaussians, moments, statistics, light } = scene;
    let blocks = shape_of_gaussians(gaussians.count, gaussians.layout);
    let mut tensors = vec![
        numbers("gaussians", &blocks, &gaussians.values),
        numbers("gaussians.mean", &blocks, &moments.mean),
        numbers("gaussians.square", &blocks, &moments.square),
        numbers("grad_sum", &[gaussians.count], &statistics.grad_sum),
        numbers("view_count", &[gaussians.count], &statistics.view_count),
    ];
    for (index, (light, moments)) in light.iter().chain(other_lights).enumerate() {
        let faces = shape_of_light(light.resolution, light.is_network());
        let all = [&light.values, &moments.mean, &moments.square];
        tensors.extend(light_names(index).into_iter().zip(all).map(|(name, values)| numbers(name, &faces, values)));
    }
    if let Some(near_field) = near_field {
        tensors.push(numbers("near_field", &[near_field.values.len()], &near_field.values));
    }
    if let Some(ExposureState { maps, moments }) = exposures {
        let shape = shape_of_exposures(maps.len());
        tensors.push(numbers("exposure", &shape, in_a_row(maps)));
        tensors.push(numbers("exposure.mean", &shape, in_a_row(&moments.mean)));
        tensors.push(numbers("exposure.square", &shape, in_a_row(&moments.square)));
    }
    tensors.push(Tensor { name: "order".into(), dtype: Dtype::U32, shape: vec![order.len()], words: order });
    tensors
}

/// Names of the tensors of a light, of its number from 0.
fn light_names(index: usize) -> [String; 3] {
    let name = if index == 0 { "light".to_owned() } else { format!("light_{}", index + 1) };
    ["", ".mean", ".square"].map(|part| format!("{name}{part}"))
}

fn numbers<'a>(name: impl Into<Cow<'static, str>>, shape: &[usize], values: &'a [f32]) -> Tensor<'a> {
    Tensor { name: name.into(), dtype: Dtype::F32, shape: shape.to_vec(), words: bytemuck::cast_slice(values) }
}

fn shape_of_gaussians(count: usize, layout: Layout) -> [usize; 3] {
    [count.div_ceil(BLOCK), layout.plane_count(), BLOCK]
}

fn shape_of_light(resolution: usize, is_network: bool) -> Vec<usize> {
    if is_network { vec![WEIGHT_COUNT] } else { vec![FACE_COUNT, resolution, resolution, 3] }
}

fn shape_of_exposures(count: usize) -> [usize; 3] {
    [count, 3, 4]
}

fn in_a_row(exposures: &[Exposure<f32>]) -> &[f32] {
    exposures.as_flattened().as_flattened()
}

fn header_bytes(checkpoint: &Checkpoint, tensors: &[Tensor<'_>]) -> io::Result<Vec<u8>> {
    let TrainingState { scene, other_lights, near_field, exposures, .. } = &checkpoint.state;
    let SceneState { gaussians, light, .. } = scene;
    let header = Header {
        format: FORMAT,
        facts: FactsHeader::of(checkpoint),
        gaussians: gaussians.count,
        is_shaded: gaussians.layout.is_shaded(),
        sh_degree: gaussians.layout.sh_degree,
        is_physical: gaussians.layout.is_physical,
        is_antialiased: gaussians.layout.is_smoothed,
        light: light.as_ref().map(|(light, _)| LightHeader {
            resolution: light.resolution,
            is_exponential: light.activation == RadianceActivation::Exponential,
            is_network: light.is_network(),
        }),
        other_lights: other_lights.len(),
        near_field: near_field
            .as_ref()
            .map(|near_field| NearFieldHeader { sizes: near_field.sizes(), offset: near_field.offset }),
        exposures: exposures.as_ref().map(|exposures| exposures.maps.len()),
    };
    let ours = HashMap::from([(KEY.to_owned(), serde_json::to_string(&header)?)]);
    let mut start = 0;
    let infos = tensors.iter().map(|Tensor { name, dtype, shape, words }| {
        let end = start + size_of_val(*words);
        let info = TensorInfo { dtype: *dtype, shape: shape.clone(), data_offsets: (start, end) };
        start = end;
        (name.clone().into_owned(), info)
    });
    let metadata = Metadata::new(Some(ours), infos.collect()).map_err(io::Error::other)?;
    let mut bytes = serde_json::to_vec(&metadata)?;
    // Tensors are aligned to eight bytes.
    bytes.resize(bytes.len().next_multiple_of(LENGTH_SIZE as usize), b' ');
    Ok(bytes)
}

fn write_words(out: &mut impl Write, words: &[u32]) -> io::Result<()> {
    words.chunks(PIECE).try_for_each(|piece| {
        let bytes: Vec<[u8; 4]> = piece.iter().map(|word| word.to_le_bytes()).collect();
        out.write_all(bytes.as_flattened())
    })
}

/// Reads the checkpoint of a model.
///
/// # Errors
///
/// [`Error::NoCheckpoint`], [`Error::CheckpointFormat`], [`Error::Checkpoint`] for invalid content,
/// [`Error::TooLarge`] beyond the memory budget, [`Error::Read`].
pub fn read(folder: &Path) -> Result<Checkpoint> {
    let mut reader = Reader::open(folder)?;
    let Header {
        facts,
        gaussians: count,
        is_shaded,
        sh_degree,
        is_physical,
        is_antialiased,
        light,
        other_lights,
        near_field,
        exposures,
        ..
    } = reader.header()?;
    if let Some(fault) = facts.fault() {
        return Err(reader.refuse("the header", fault));
    }
    if sh_degree.is_some_and(|degree| degree > 3) {
        return Err(reader.refuse("the header", "harmonics have a degree from 0 to 3"));
    }
    let layout = Layout { sh_degree, ..if is_shaded { Layout::shaded(None) } else { Layout::radiance(0) } };
    let layout = if is_physical { layout.physical() } else { layout };
    let layout = if is_antialiased { layout.antialiased() } else { layout };
    let blocks = shape_of_gaussians(count, layout);
    let values = reader.numbers("gaussians", &blocks)?;
    let scene = SceneState {
        gaussians: Gaussians { count, layout, values },
        moments: reader.moments(["gaussians.mean", "gaussians.square"], &blocks)?,
        statistics: Statistics {
            grad_sum: reader.numbers("grad_sum", &[count])?,
            view_count: reader.numbers("view_count", &[count])?,
        },
        light: light.map(|light| reader.light(light, 0)).transpose()?,
    };
    // A light that the file lacks ends the reading, so the number need not be bounded.
    let others = light.into_iter().flat_map(|light| iter::repeat_n(light, other_lights)).zip(1..);
    let other_lights = others.map(|(light, index)| reader.light(light, index)).collect::<Result<_>>()?;
    let near_field = near_field.map(|header| reader.near_field(header)).transpose()?;
    let exposures = exposures.map(|count| reader.exposures(count)).transpose()?;
    let order = reader.order()?;
    let FactsHeader { program, iteration, iterations, seconds, psnr, nonfinite, .. } = facts;
    let FactsHeader { seed, config, settings, views, pictures, .. } = facts;
    Ok(Checkpoint {
        state: TrainingState { scene, other_lights, near_field, exposures, order, iteration, psnr, nonfinite },
        facts: Facts { program, iterations, seconds, seed, config, settings, views, pictures },
    })
}

/// Checkpoint with its header read.
struct Reader {
    path: PathBuf,
    file: File,
    /// Byte offset of the tensors.
    start: u64,
    metadata: Metadata,
}

impl Reader {
    /// Reads the header and checks that the tensors fill the file.
    fn open(folder: &Path) -> Result<Self> {
        let path = path_in(folder);
        if !within::holds(&path)? {
            return Err(Error::NoCheckpoint { path: folder.to_owned() });
        }
        let mut file = within::open(&path)?;
        let size = file.metadata().map_err(Error::reading(&path))?.len();
        let refuse = |cause: &dyn Display| broken(&path, "the header", cause);

        let mut length = [0; LENGTH_SIZE as usize];
        file.read_exact(&mut length).map_err(|_| refuse(&format_args!("the file has {size} bytes")))?;
        let length = u64::from_le_bytes(length);
        if length > size.saturating_sub(LENGTH_SIZE).min(CHECKPOINT_HEADER_MAX) {
            return Err(refuse(&format_args!("it would take {length} of {size} bytes")));
        }
        let mut header = vec![0; length as usize];
        file.read_exact(&mut header).map_err(Error::reading(&path))?;
        let metadata: Metadata = serde_json::from_slice(&header).map_err(|error| refuse(&error))?;

        let start = LENGTH_SIZE + length;
        let expected = start.saturating_add(metadata.data_len() as u64);
        if expected != size {
            return Err(broken(
                &path,
                "the tensors",
                &format_args!("they should end after {expected} bytes, not {size}"),
            ));
        }
        Ok(Self { path, file, start, metadata })
    }

    fn refuse(&self, place: &str, cause: impl Display) -> Error {
        broken(&self.path, place, &cause)
    }

    /// Parses specula's entry in the metadata.
    fn header(&self) -> Result<Header> {
        let ours = self.metadata.metadata().as_ref().and_then(|all| all.get(KEY));
        let ours = ours.ok_or_else(|| self.refuse("the header", "it was not written by specula"))?;
        let refuse = |error: serde_json::Error| self.refuse("the header", error);
        let AnyHeader { format } = serde_json::from_str(ours).map_err(refuse)?;
        if format != FORMAT {
            return Err(Error::CheckpointFormat { path: self.path.clone(), found: format, known: FORMAT });
        }
        serde_json::from_str(ours).map_err(refuse)
    }

    fn numbers(&mut self, name: &str, shape: &[usize]) -> Result<Vec<f32>> {
        let info = self.info(name, Dtype::F32)?;
        if info.shape != shape {
            let cause = format!("its shape is {:?} rather than {shape:?}", info.shape);
            return Err(self.refuse(&format!("tensor {name:?}"), cause));
        }
        let bits: Vec<u32> = self.words(name, &info)?;
        let numbers: Vec<f32> = bits.into_iter().map(f32::from_bits).collect();
        let broken = numbers.iter().filter(|number| !number.is_finite()).count();
        if broken > 0 {
            let cause = format!("{broken} of its {} numbers are NaN or infinite", numbers.len());
            return Err(self.refuse(&format!("tensor {name:?}"), cause));
        }
        Ok(numbers)
    }

    fn moments(&mut self, [mean, square]: [&str; 2], shape: &[usize]) -> Result<AdamMoments<Vec<f32>>> {
        Ok(AdamMoments { mean: self.numbers(mean, shape)?, square: self.squares(square, shape)? })
    }

    /// Reads means of squares, which must not be negative.
    fn squares(&mut self, name: &str, shape: &[usize]) -> Result<Vec<f32>> {
        let squares = self.numbers(name, shape)?;
        match squares.iter().any(|square| *square < 0.0) {
            true => Err(self.refuse(&format!("tensor {name:?}"), "squares are not negative")),
            false => Ok(squares),
        }
    }

    fn light(&mut self, header: LightHeader, index: usize) -> Result<FittedLight<Vec<f32>>> {
        let LightHeader { resolution, is_exponential, is_network } = header;
        let faces = shape_of_light(resolution, is_network);
        let activation = match (is_network, is_exponential) {
            (true, _) => RadianceActivation::Network,
            (false, true) => RadianceActivation::Exponential,
            (false, false) => RadianceActivation::Identity,
        };
        let [numbers, mean, square] = light_names(index);
        let light = Environment { resolution, activation, values: self.numbers(&numbers, &faces)? };
        Ok((light, self.moments([&mean, &square], &faces)?))
    }

    fn near_field(&mut self, header: NearFieldHeader) -> Result<NearField<Vec<f32>>> {
        const NAME: &str = "near_field";
        let NearFieldHeader { sizes, offset } = header;
        if sizes.iter().any(|size| *size >= INDEX_MAX) {
            return Err(self.refuse("the header", NearFieldError::Size));
        }
        let len = NearField::of_sizes(sizes, offset, ()).len_of_values();
        let near_field = NearField::of_sizes(sizes, offset, self.numbers(NAME, &[len])?);
        near_field.check().map_err(|fault| self.refuse(&format!("tensor {NAME:?}"), fault))?;
        Ok(near_field)
    }

    fn exposures(&mut self, count: usize) -> Result<ExposureState> {
        let shape = shape_of_exposures(count);
        let maps = |numbers: Vec<f32>| -> Vec<Exposure<f32>> {
            let rows = numbers.as_chunks::<4>().0;
            rows.as_chunks::<3>().0.to_vec()
        };
        let moments = self.moments(["exposure.mean", "exposure.square"], &shape)?;
        Ok(ExposureState {
            maps: maps(self.numbers("exposure", &shape)?),
            moments: AdamMoments { mean: maps(moments.mean), square: maps(moments.square) },
        })
    }

    /// Reads the order of views, of any length.
    fn order(&mut self) -> Result<Vec<u32>> {
        let info = self.info("order", Dtype::U32)?;
        self.words("order", &info)
    }

    fn info(&self, name: &str, dtype: Dtype) -> Result<TensorInfo> {
        let refuse = |cause: &dyn Display| self.refuse(&format!("tensor {name:?}"), cause);
        let info = self.metadata.info(name).ok_or_else(|| refuse(&"it is missing"))?;
        if info.dtype != dtype {
            return Err(refuse(&format_args!("its numbers are {} rather than {dtype}", info.dtype)));
        }
        Ok(info.clone())
    }

    /// Reads the words of a tensor; its range has been checked against the file.
    fn words(&mut self, name: &str, info: &TensorInfo) -> Result<Vec<u32>> {
        let (start, end) = info.data_offsets;
        SCENE.ask(&self.path, 0, format!("its tensor {name:?}"), (end - start) as u64)?;
        let mut words = vec![0_u32; (end - start) / size_of::<u32>()];
        let found = self.file.seek(SeekFrom::Start(self.start + start as u64));
        let read = found.and_then(|_| self.file.read_exact(bytemuck::cast_slice_mut(&mut words)));
        read.map_err(|cause| self.refuse(&format!("tensor {name:?}"), cause))?;
        words.iter_mut().for_each(|word| *word = u32::from_le(*word));
        Ok(words)
    }
}

fn broken(path: &Path, place: &str, cause: &dyn Display) -> Error {
    Error::Checkpoint { path: path.to_owned(), place: place.to_owned(), cause: cause.to_string() }
}
