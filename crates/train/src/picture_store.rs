//! Pictures that are decoded ahead of their use, within a memory budget.
//!
//! The schedule of the views determines the turns. Threads decode the pictures with the next turns,
//! and if memory is short they free those with the farthest next turn. If a picture is not ready at
//! its turn, the requesting thread decodes it. The trained pixels do not depend on any of this.
//!
//! Several ranks of one program may share a store, so that each picture is decoded and held once.

use crate::{
    pictures::{PictureError, PictureKey, PictureSource, Pictures, Turn},
    view::{View, pixel_bytes},
};
use core::{cmp::Reverse, fmt, panic::AssertUnwindSafe};
use specula_core::camera::Camera;
use std::{
    collections::{HashMap, VecDeque},
    panic::catch_unwind,
    sync::{Arc, Condvar, Mutex, MutexGuard},
    thread::{self, JoinHandle},
};

/// Decoder of a view at full size, by its index.
type Open = dyn Fn(usize) -> Result<View, PictureError> + Send + Sync;

/// Pictures in memory, and threads that decode more.
#[derive(Debug)]
pub struct PictureStore {
    shelf: Arc<Shelf>,
    decoders: Vec<JoinHandle<()>>,
}

/// Statistics of the pictures that a store keeps or decodes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Held {
    /// Pictures now.
    pub pictures: usize,
    /// Bytes of their pixels now.
    pub bytes: u64,
    /// Maximum number of pictures so far.
    pub pictures_max: usize,
    /// Maximum number of bytes so far.
    pub bytes_max: u64,
    /// Number of decoded pictures so far.
    pub decoded: usize,
}

impl PictureStore {
    /// Store of pictures with these cameras and [`pixel_bytes`] for each pixel, which keeps at most
    /// `budget` bytes of pixels, or a single larger picture. `open` decodes a view, on one of
    /// `decoders` threads.
    ///
    /// # Panics
    ///
    /// Panics if the system has no more threads.
    pub fn new(
        cameras: Vec<Camera>,
        pixel_bytes: u64,
        budget: u64,
        decoders: usize,
        open: impl Fn(usize) -> Result<View, PictureError> + Send + Sync + 'static,
    ) -> Self {
        let shelf = Arc::new(Shelf {
            cameras,
            pixel_bytes,
            budget,
            open: Box::new(open),
            state: Mutex::new(State::default()),
            changed: Condvar::new(),
        });
        let decode = |_| {
            let shelf = Arc::clone(&shelf);
            thread::Builder::new()
                .name("pictures".into())
                .spawn(move || shelf.decode_ahead())
                .expect("there is a thread")
        };
        let decoders = (0..decoders).map(decode).collect();
        Self { shelf, decoders }
    }

    /// Adds a decoded view if there is room; otherwise it is decoded at its turn.
    pub fn add(&self, index: usize, view: View) {
        let picture = PictureKey { view: index, is_halved: false };
        let bytes = self.shelf.bytes_of(picture);
        let mut state = self.shelf.lock();
        if state.bytes + bytes <= self.shelf.budget && !state.places.contains_key(&picture) {
            state.hold(picture, bytes, view);
        }
    }

    /// Statistics of the kept pictures.
    pub fn held(&self) -> Held {
        self.shelf.lock().count
    }
}

impl PictureSource for PictureStore {
    fn pictures(&self) -> Box<dyn Pictures> {
        let mut state = self.shelf.lock();
        let reader = state.next_reader;
        state.next_reader += 1;
        state.turns.insert(reader, VecDeque::new());
        Box::new(Reader { shelf: Arc::clone(&self.shelf), reader })
    }
}

/// Views in memory, each halved only once.
impl PictureSource for [View] {
    fn pictures(&self) -> Box<dyn Pictures> {
        let cameras = self.iter().map(|view| view.camera).collect();
        let pixel_bytes = pixel_bytes(self.iter().any(|view| view.unclipped.is_some()));
        let store = PictureStore::new(cameras, pixel_bytes, u64::MAX, 0, |_| {
            Err(PictureError("a picture was given away".into()))
        });
        self.iter().enumerate().for_each(|(index, view)| store.add(index, view.clone()));
        store.pictures()
    }
}

impl PictureSource for Vec<View> {
    fn pictures(&self) -> Box<dyn Pictures> {
        self.as_slice().pictures()
    }
}

impl<const COUNT: usize> PictureSource for [View; COUNT] {
    fn pictures(&self) -> Box<dyn Pictures> {
        self.as_slice().pictures()
    }
}

impl Drop for PictureStore {
    fn drop(&mut self) {
        self.shelf.lock().is_closed = true;
        self.shelf.changed.notify_all();
        for decoder in self.decoders.drain(..) {
            // Decoders catch panics.
            let _ = decoder.join();
        }
    }
}

/// Contents of a store, shared by its decoders and readers.
struct Shelf {
    cameras: Vec<Camera>,
    pixel_bytes: u64,
    budget: u64,
    open: Box<Open>,
    state: Mutex<State>,
    /// Notified when a picture is decoded or returned, and when turns change.
    changed: Condvar,
}

impl fmt::Debug for Shelf {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "Shelf({} pictures, {} bytes)", self.cameras.len(), self.budget)
    }
}

/// Picture to decode, with reserved memory.
struct Job {
    picture: PictureKey,
    /// The picture at full size, the source of the halved one.
    whole: Option<Arc<View>>,
}

/// State of a picture.
enum Place {
    /// Picture in decoding, with its reserved bytes.
    Opening(u64),
    Held(Arc<View>, u64),
    /// Picture that cannot be decoded.
    Failed(PictureError),
}

#[derive(Default)]
struct State {
    places: HashMap<PictureKey, Place>,
    /// Bytes kept or reserved.
    bytes: u64,
    /// Next turns of each reader.
    turns: HashMap<usize, VecDeque<Turn>>,
    next_reader: usize,
    count: Held,
    is_closed: bool,
}

impl State {
    /// The full-size source of a halved picture, if it is in memory.
    fn whole_of(&self, PictureKey { view, is_halved }: PictureKey) -> Option<&Arc<View>> {
        match self.places.get(&PictureKey { view, is_halved: false }) {
            Some(Place::Held(whole, _)) if is_halved => Some(whole),
            _ => None,
        }
    }

    fn reserve(&mut self, picture: PictureKey, bytes: u64) {
        self.places.insert(picture, Place::Opening(bytes));
        self.bytes += bytes;
        self.count.pictures += 1;
        self.note_most();
    }

    fn hold(&mut self, picture: PictureKey, bytes: u64, view: View) {
        self.places.insert(picture, Place::Held(Arc::new(view), bytes));
        self.bytes += bytes;
        self.count.pictures += 1;
        self.note_most();
    }

    fn note_most(&mut self) {
        let Held { pictures, bytes, pictures_max, bytes_max, .. } = &mut self.count;
        *bytes = self.bytes;
        *pictures_max = (*pictures_max).max(*pictures);
        *bytes_max = (*bytes_max).max(*bytes);
    }

    fn take_out(&mut self, picture: PictureKey) {
        if let Some(Place::Opening(bytes) | Place::Held(_, bytes)) = self.places.remove(&picture) {
            self.bytes -= bytes;
            self.count.pictures -= 1;
            self.count.bytes = self.bytes;
        }
    }

    /// Next visit of each picture with a turn.
    fn next_visits(&self) -> HashMap<PictureKey, u64> {
        let mut next = HashMap::new();
        for turn in self.turns.values().flatten() {
            let visit = next.entry(turn.picture).or_insert(turn.visit);
            *visit = turn.visit.min(*visit);
        }
        next
    }

    /// Frees pictures until `bytes` fit into the budget: those with the farthest next visit, later
    /// than `visit`. Frees none if that is not enough.
    fn make_room(&mut self, budget: u64, bytes: u64, visit: u64, next: &HashMap<PictureKey, u64>) -> bool {
        let Some(spare) = budget.checked_sub(bytes) else { return false };
        if self.bytes <= spare {
            return true;
        }
        let later = |(picture, place): (&PictureKey, &Place)| match place {
            // A picture in use has another owner.
            Place::Held(view, bytes) if Arc::strong_count(view) == 1 => {
                let turn = next.get(picture).copied().unwrap_or(u64::MAX);
                (turn > visit).then_some((Reverse(turn), *picture, *bytes))
            }
            _ => None,
        };
        let mut later: Vec<_> = self.places.iter().filter_map(later).collect();
        if self.bytes - later.iter().map(|(.., bytes)| bytes).sum::<u64>() > spare {
            return false;
        }
        later.sort_unstable();
        for (_, picture, _) in later {
            if self.bytes <= spare {
                break;
            }
            self.take_out(picture);
        }
        true
    }
}

impl Shelf {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().expect("no thread panics with the pictures locked")
    }

    fn wait<'a>(&self, state: MutexGuard<'a, State>) -> MutexGuard<'a, State> {
        self.changed.wait(state).expect("no thread panics with the pictures locked")
    }

    /// Bytes of the pixels of a picture.
    fn bytes_of(&self, PictureKey { view, is_halved }: PictureKey) -> u64 {
        let Camera { width, height, .. } = self.cameras[view];
        let part = if is_halved { 2 } else { 1 };
        self.pixel_bytes * u64::from(width / part) * u64::from(height / part)
    }

    /// Bytes during decoding, which starts at full size.
    fn bytes_to_open(&self, picture: PictureKey) -> u64 {
        self.bytes_of(PictureKey { is_halved: false, ..picture })
    }

    /// Bytes of all pictures at both sizes.
    fn bytes_of_all(&self) -> u64 {
        let both = |view: usize| [false, true].map(|is_halved| self.bytes_of(PictureKey { view, is_halved }));
        (0..self.cameras.len()).flat_map(both).sum()
    }

    /// Decodes pictures in the order of their turns until the store is closed.
    fn decode_ahead(&self) {
        let mut state = self.lock();
        while !state.is_closed {
            match self.next_to_decode(&mut state) {
                Some(job) => {
                    drop(state);
                    self.decode(job);
                    state = self.lock();
                }
                None => state = self.wait(state),
            }
        }
    }

    /// Reserves memory for the first picture with a turn that is not in memory; `None` if there is
    /// no such picture, or no room for it.
    fn next_to_decode(&self, state: &mut State) -> Option<Job> {
        let next = state.next_visits();
        let missing = next.iter().filter(|(picture, _)| !state.places.contains_key(picture));
        let (visit, picture) = missing.map(|(picture, visit)| (*visit, *picture)).min()?;
        self.begin(state, picture, self.budget, visit, &next)
    }

    /// Reserves memory for a picture, if freeing others with visits after `visit` is enough.
    fn begin(
        &self,
        state: &mut State,
        picture: PictureKey,
        budget: u64,
        visit: u64,
        next: &HashMap<PictureKey, u64>,
    ) -> Option<Job> {
        // This reference prevents freeing the picture at full size.
        if let Some(whole) = state.whole_of(picture).cloned() {
            let bytes = self.bytes_of(picture);
            if state.make_room(budget, bytes, visit, next) {
                state.reserve(picture, bytes);
                return Some(Job { picture, whole: Some(whole) });
            }
        }
        // Without room for both, it is freed and decoded again.
        let bytes = self.bytes_to_open(picture);
        if !state.make_room(budget, bytes, visit, next) {
            return None;
        }
        state.reserve(picture, bytes);
        Some(Job { picture, whole: None })
    }

    /// Decodes a picture with reserved memory.
    fn decode(&self, Job { picture, whole }: Job) {
        let open = || match (picture.is_halved, &whole) {
            (false, _) => (self.open)(picture.view),
            (true, Some(whole)) => Ok(whole.halved()),
            (true, None) => Ok((self.open)(picture.view)?.halved()),
        };
        let opened = catch_unwind(AssertUnwindSafe(open));
        let opened = opened.unwrap_or_else(|_| Err(PictureError("the decoder of a picture panicked".into())));
        drop(whole);
        let mut state = self.lock();
        state.take_out(picture);
        match opened {
            Ok(view) => state.hold(picture, self.bytes_of(picture), view),
            Err(error) => drop(state.places.insert(picture, Place::Failed(error))),
        }
        state.count.decoded += 1;
        drop(state);
        self.changed.notify_all();
    }

    /// Picture of a turn, decoded here if it is not ready.
    fn take(&self, reader: usize, turn: Turn) -> Result<Arc<View>, PictureError> {
        let Turn { picture, visit } = turn;
        let mut state = self.lock();
        loop {
            match state.places.get(&picture) {
                Some(Place::Held(view, _)) => {
                    let view = Arc::clone(view);
                    let turns = state.turns.entry(reader).or_default();
                    while turns.front().is_some_and(|turn| turn.visit <= visit) {
                        turns.pop_front();
                    }
                    return Ok(view);
                }
                // The next attempt decodes it again.
                Some(Place::Failed(error)) => {
                    let error = error.clone();
                    state.places.remove(&picture);
                    return Err(error);
                }
                Some(Place::Opening(_)) => state = self.wait(state),
                None => {
                    let next = state.next_visits();
                    // A picture larger than the budget is the only one in memory.
                    let budget = self.budget.max(self.bytes_to_open(picture));
                    match self.begin(&mut state, picture, budget, 0, &next) {
                        Some(job) => {
                            drop(state);
                            self.decode(job);
                            state = self.lock();
                        }
                        None => state = self.wait(state),
                    }
                }
            }
        }
    }
}

/// Pictures of one training, or of one of its ranks.
#[derive(Debug)]
struct Reader {
    shelf: Arc<Shelf>,
    reader: usize,
}

impl Pictures for Reader {
    fn cameras(&self) -> Vec<Camera> {
        self.shelf.cameras.clone()
    }

    fn expect(&mut self, turns: &[Turn]) {
        self.shelf.lock().turns.insert(self.reader, turns.iter().copied().collect());
        self.shelf.changed.notify_all();
    }

    fn show(&mut self, turn: Turn, look: &mut dyn FnMut(&View)) -> Result<(), PictureError> {
        let view = self.shelf.take(self.reader, turn)?;
        look(&view);
        drop(view);
        // Decoders may be waiting for the memory of the picture.
        drop(self.shelf.lock());
        self.shelf.changed.notify_all();
        Ok(())
    }

    fn are_kept_by_viewer(&self) -> bool {
        self.shelf.bytes_of_all() <= self.shelf.budget && self.shelf.lock().turns.len() == 1
    }

    fn release(&mut self, picture: PictureKey) {
        let mut state = self.shelf.lock();
        if matches!(state.places.get(&picture), Some(Place::Held(..))) {
            state.take_out(picture);
        }
        drop(state);
        self.shelf.changed.notify_all();
    }
}

impl Drop for Reader {
    fn drop(&mut self) {
        self.shelf.lock().turns.remove(&self.reader);
        self.shelf.changed.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::sync::atomic::{AtomicUsize, Ordering};
    use glam::Vec3;

    const SIZE: u32 = 8;
    const PICTURE: u64 = 4 * (SIZE * SIZE) as u64;

    fn cameras(count: usize) -> Vec<Camera> {
        vec![Camera::look_at(Vec3::X * 4.0, Vec3::ZERO, Vec3::Z, 0.7, SIZE, SIZE); count]
    }

    /// View with its number as pixels.
    fn view(index: usize) -> View {
        let rgba = vec![index as u8; PICTURE as usize];
        View { name: index.to_string(), camera: cameras(1)[0], rgba, unclipped: None, normals: None }
    }

    fn turns(views: &[usize], is_halved: bool) -> Vec<Turn> {
        (1..).zip(views).map(|(visit, view)| Turn { visit, picture: PictureKey { view: *view, is_halved } }).collect()
    }

    /// First byte and size of a picture.
    fn seen(pictures: &mut dyn Pictures, turn: Turn) -> Result<(u8, u32), PictureError> {
        let mut seen = None;
        pictures.show(turn, &mut |view| seen = Some((view.rgba[0], view.camera.width)))?;
        Ok(seen.expect("it was shown"))
    }

    #[test]
    fn every_turn_shows_its_picture_within_the_budget() {
        let views = [3, 1, 4, 1, 5, 0, 2, 3, 5, 4, 0, 1, 2];
        for budget in [0, 1, 2, 3, 6] {
            for decoders in [0, 1, 3] {
                let store = PictureStore::new(cameras(6), 4, budget * PICTURE, decoders, |index| Ok(view(index)));
                let mut pictures = store.pictures();
                let all = [turns(&views, true), turns(&views, false)];
                for (turns, size) in all.iter().zip([SIZE / 2, SIZE]) {
                    pictures.expect(turns);
                    for (turn, view) in turns.iter().zip(views) {
                        assert_eq!(seen(pictures.as_mut(), *turn), Ok((view as u8, size)), "{budget} on {decoders}");
                    }
                }
                let held = store.held();
                assert!(
                    held.bytes_max <= budget.max(1) * PICTURE,
                    "{held:?} of {budget} pictures on {decoders} threads"
                );
                assert!(budget > 0 || held.pictures_max == 1, "{held:?}");
            }
        }
    }

    #[test]
    fn pictures_needed_soon_are_kept() {
        let decoded = Arc::new(AtomicUsize::new(0));
        let count = Arc::clone(&decoded);
        let open = move |index: usize| {
            count.fetch_add(1, Ordering::Relaxed);
            Ok(view(index))
        };
        let store = PictureStore::new(cameras(3), 4, 2 * PICTURE, 0, open);
        let mut pictures = store.pictures();
        let turns = turns(&[0, 1, 2, 0, 1, 0], false);
        pictures.expect(&turns);
        for turn in &turns {
            seen(pictures.as_mut(), *turn).expect("it can be decoded");
        }
        // Picture 2 evicts 1, which has the later turn; 1 then evicts 2, which has no turn.
        assert_eq!(decoded.load(Ordering::Relaxed), 4);
    }

    #[test]
    fn added_pictures_are_not_decoded_and_a_single_reader_may_keep_them() {
        let store =
            PictureStore::new(cameras(2), 4, 3 * PICTURE, 0, |index| Err(PictureError(format!("{index} is away"))));
        store.add(1, view(1));
        let mut pictures = store.pictures();
        assert!(pictures.are_kept_by_viewer(), "all fit at both sizes");
        let turn = turns(&[1], false)[0];
        assert_eq!(seen(pictures.as_mut(), turn), Ok((1, SIZE)));
        pictures.release(turn.picture);
        assert_eq!((store.held().pictures, store.held().bytes), (0, 0));
        let other = store.pictures();
        assert!(!pictures.are_kept_by_viewer(), "another rank needs them");
        drop(other);
        let tight = PictureStore::new(cameras(2), 4, 2 * PICTURE, 0, |index| Ok(view(index)));
        assert!(!tight.pictures().are_kept_by_viewer(), "there is no room for smaller ones");
    }

    #[test]
    fn failures_are_reported_at_their_turn_and_may_be_temporary() {
        let tries = AtomicUsize::new(0);
        let open = move |index: usize| match (index, tries.fetch_add(1, Ordering::Relaxed)) {
            (1, ..3) => Err(PictureError("it is away".into())),
            (2, _) => panic!("a decoder with a fault"),
            (index, _) => Ok(view(index)),
        };
        let store = PictureStore::new(cameras(3), 4, 3 * PICTURE, 0, open);
        let mut pictures = store.pictures();
        let turns = turns(&[0, 1, 2], false);
        assert_eq!(seen(pictures.as_mut(), turns[0]), Ok((0, SIZE)));
        for expected in [Err(PictureError("it is away".into())), Err(PictureError("it is away".into())), Ok((1, SIZE))]
        {
            assert_eq!(seen(pictures.as_mut(), turns[1]), expected);
        }
        assert!(seen(pictures.as_mut(), turns[2]).is_err(), "a panic does not block readers");
    }

    #[test]
    fn a_picture_is_halved_without_room_for_both_sizes() {
        let store = PictureStore::new(cameras(1), 4, PICTURE, 0, |index| Ok(view(index)));
        let mut pictures = store.pictures();
        for is_halved in [false, true, false] {
            let [turn] = turns(&[0], is_halved)[..] else { panic!("there is one turn") };
            pictures.expect(&[turn]);
            let size = if is_halved { SIZE / 2 } else { SIZE };
            assert_eq!(seen(pictures.as_mut(), turn), Ok((0, size)));
        }
        assert!(store.held().bytes_max <= PICTURE, "{:?}", store.held());
    }

    #[test]
    fn readers_of_a_store_wait_for_each_other_and_all_finish() {
        let store = PictureStore::new(cameras(5), 4, PICTURE, 1, |index| Ok(view(index)));
        thread::scope(|scope| {
            for reader in 0..4 {
                let mut pictures = store.pictures();
                scope.spawn(move || {
                    let views: Vec<usize> = (0..50).map(|k| (k * (reader + 1) + reader) % 5).collect();
                    let turns = turns(&views, reader % 2 == 0);
                    pictures.expect(&turns);
                    for (turn, view) in turns.iter().zip(views) {
                        assert_eq!(seen(pictures.as_mut(), *turn).map(|(byte, _)| byte), Ok(view as u8));
                    }
                });
            }
        });
        assert!(store.held().bytes_max <= PICTURE, "{:?}", store.held());
    }
}
