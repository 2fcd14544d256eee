//! Facts of pictures that every rank needs, and their messages.

use super::{Decoded, Reading, malformed};
use crate::{SceneError, dataset::pixel_checksum};
use specula_core::camera::Camera;
use specula_io::{
    cameras::NamedCamera,
    dataset::{self, Album, Changes},
    pixels::Pixels,
};
use specula_train::{
    exchange::{Exchange, ExchangeError},
    start::{PixelSample, Silhouette},
};

/// A picture with its camera, not in memory.
#[derive(Clone, Debug, PartialEq)]
pub struct Photograph {
    /// Name in the data set.
    pub name: String,
    /// Camera of the picture.
    pub camera: Camera,
    /// Whether any pixel is not opaque.
    pub has_alpha: bool,
    /// Whether there are ground-truth normals.
    pub has_normals: bool,
    /// Changes of the picture during decoding.
    pub changes: Changes,
    /// CRC-32 of its pixels.
    pub checksum: u32,
}

impl Photograph {
    /// Camera with the name of the picture.
    pub fn named_camera(&self) -> NamedCamera {
        (self.name.clone(), self.camera)
    }
}

/// Parts of a picture that initial points follow from.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Extracts {
    pub(super) silhouette: Option<Silhouette>,
    pub(super) sample: PixelSample,
}

/// Parts of the pictures to extract.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Wanted {
    silhouettes: bool,
    /// Number of points appended to those of the data set.
    background: usize,
    seed: u64,
    /// Number of views to train on.
    train: usize,
}

impl Wanted {
    pub(super) fn new(reading: &Reading<'_>, points: Option<&[specula_train::start::Point]>, train: usize) -> Self {
        let Some(initial) = reading.points else { return Self::default() };
        let is_random = initial.random.is_some() || points.is_none_or(<[_]>::is_empty);
        let background = if is_random { 0 } else { initial.background as usize };
        Self { silhouettes: is_random, background, seed: reading.seed, train }
    }
}

/// Facts of a picture without its name, which the list contains.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Facts {
    photograph: Photograph,
    extracts: Extracts,
}

impl Facts {
    pub(super) fn of(view: &dataset::View, changes: Changes, wanted: &Wanted, index: usize) -> Self {
        let Pixels { rgba, unclipped, .. } = &view.image;
        let is_trained_on = index < wanted.train;
        let sample = if is_trained_on && wanted.background > 0 {
            PixelSample::of(index, wanted.train, wanted.background, &view.camera, rgba, wanted.seed)
        } else {
            PixelSample::default()
        };
        let silhouette = if is_trained_on && wanted.silhouettes { Silhouette::of(rgba) } else { None };
        let photograph = Photograph {
            name: String::new(),
            camera: view.camera,
            has_alpha: specula_core::color::has_alpha(rgba),
            has_normals: view.normal.is_some(),
            changes,
            checksum: pixel_checksum(rgba, unclipped.as_deref()),
        };
        Self { photograph, extracts: Extracts { silhouette, sample } }
    }

    pub(super) fn named(self, name: &str) -> (Photograph, Extracts) {
        (Photograph { name: name.to_owned(), ..self.photograph }, self.extracts)
    }

    fn write(&self, out: &mut Vec<u8>) {
        let Photograph { camera, has_alpha, has_normals, changes, checksum, .. } = &self.photograph;
        // The light follows from all cameras, later.
        let Camera { camera_from_world, position, focal_px, principal_px, near, width, height, .. } = *camera;
        let numbers = camera_from_world.to_cols_array().into_iter().chain(position.to_array());
        for number in numbers.chain(focal_px).chain(principal_px).chain([near]) {
            out.extend(number.to_le_bytes());
        }
        [width, height, *checksum].iter().for_each(|number| out.extend(number.to_le_bytes()));
        [changes.unknown, changes.pixels].iter().for_each(|number| out.extend(number.to_le_bytes()));
        let Changes { is_turned, is_undistorted, is_unclipped, .. } = *changes;
        out.extend([*has_alpha, *has_normals, is_turned, is_undistorted, is_unclipped].map(u8::from));
        let Extracts { silhouette, sample } = &self.extracts;
        let silhouette = silhouette.as_ref().map(Silhouette::bytes);
        out.push(u8::from(silhouette.is_some()));
        for part in [silhouette.unwrap_or_default(), sample.rgba.as_flattened()] {
            out.extend((part.len() as u64).to_le_bytes());
            out.extend_from_slice(part);
        }
    }

    fn read(message: &mut Message<'_>) -> Option<Self> {
        let mut numbers = [0.0; 17];
        for number in &mut numbers {
            *number = f32::from_le_bytes(message.array()?);
        }
        let [width, height, checksum] = [message.number()?, message.number()?, message.number()?];
        let [unknown, pixels] = [message.long()?, message.long()?];
        let [has_alpha, has_normals, is_turned, is_undistorted, is_unclipped, has_silhouette] =
            message.array::<6>()?.map(|flag| flag == 1);
        let [silhouette, sample] = [message.part()?.to_vec(), message.part()?.to_vec()];
        let camera = Camera {
            camera_from_world: glam::Mat3::from_cols_slice(&numbers[..9]),
            position: glam::Vec3::from_slice(&numbers[9..12]),
            focal_px: [numbers[12], numbers[13]],
            principal_px: [numbers[14], numbers[15]],
            near: numbers[16],
            width,
            height,
            light_from_world: None,
            scissor: None,
            light: 0,
        };
        let changes = Changes { is_undistorted, is_turned, is_unclipped, unknown, pixels };
        let photograph = Photograph { name: String::new(), camera, has_alpha, has_normals, changes, checksum };
        let silhouette = has_silhouette.then(|| Silhouette::from_bytes(silhouette));
        Some(Self {
            photograph,
            extracts: Extracts { silhouette, sample: PixelSample { rgba: sample.as_chunks().0.to_vec() } },
        })
    }
}

/// Bytes of a message that are not read yet.
struct Message<'a>(&'a [u8]);

impl<'a> Message<'a> {
    fn take(&mut self, len: usize) -> Option<&'a [u8]> {
        let (part, rest) = self.0.split_at_checked(len)?;
        self.0 = rest;
        Some(part)
    }

    fn array<const LEN: usize>(&mut self) -> Option<[u8; LEN]> {
        self.take(LEN)?.try_into().ok()
    }

    fn number(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    fn long(&mut self) -> Option<u64> {
        self.array().map(u64::from_le_bytes)
    }

    fn part(&mut self) -> Option<&'a [u8]> {
        let len = usize::try_from(self.long()?).ok()?;
        self.take(len)
    }
}

/// Rejects ranks that list another data set; returns the largest number of ranks on one machine.
pub(super) fn greet(exchange: &mut dyn Exchange, album: &Album, reading: &Reading<'_>) -> Result<usize, ExchangeError> {
    let Reading { options, points, seed, .. } = reading;
    let text = format!("{options:?} {points:?} {seed}\n{}", album.description());
    let mut own = crc32fast::hash(text.as_bytes()).to_le_bytes().to_vec();
    own.extend((reading.local as u64).to_le_bytes());
    let all = exchange.all_gather(own)?;
    let sum = |message: &[u8]| Message(message).number();
    if let Some(rank) = all.iter().position(|message| sum(message) != sum(&all[0])) {
        return Err(ExchangeError::Different { rank, what: "settings or pictures" });
    }
    let local = |message: &Vec<u8>| Message(message.get(4..).unwrap_or_default()).long().unwrap_or(0);
    Ok(all.iter().map(local).max().unwrap_or(0) as usize + 1)
}

/// Facts of all pictures, which ranks decoded in turn.
pub(super) fn gather(exchange: &mut dyn Exchange, own: Decoded, count: usize) -> Result<Vec<Facts>, SceneError> {
    let mut message = vec![u8::from(own.is_ok())];
    match &own {
        Ok(facts) => facts.iter().for_each(|facts| facts.write(&mut message)),
        Err((index, error)) => {
            message.extend((*index as u64).to_le_bytes());
            message.extend_from_slice(error.to_string().as_bytes());
        }
    }
    let all = exchange.all_gather(message).map_err(SceneError::Ranks)?;
    let mut messages: Vec<Message<'_>> = all.iter().map(|message| Message(message)).collect();
    let mut failed = Vec::new();
    for (rank, message) in messages.iter_mut().enumerate() {
        if message.array() != Some([1]) {
            let index = message.long().ok_or_else(|| malformed(rank))?;
            failed.push((index, rank, String::from_utf8_lossy(message.0).into_owned()));
        }
    }
    if let Some((_, rank, sentence)) = failed.into_iter().min() {
        return Err(match own {
            Err((_, error)) if rank == exchange.rank() => error.into(),
            _ => SceneError::Training(sentence),
        });
    }
    let ranks = messages.len();
    let read = |index: usize| Facts::read(&mut messages[index % ranks]).ok_or_else(|| malformed(index % ranks));
    (0..count).map(read).collect()
}

/// Facts of all pictures, which one rank decoded.
pub(super) fn whole(own: Decoded) -> Result<Vec<Facts>, SceneError> {
    own.map_err(|(_, error)| error.into())
}
