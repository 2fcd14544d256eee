//! Connections: how many are open at once, and which of them makes room for another. Most descriptors are left to the
//! rest of the program, so that a training does not fail because of those who watch it.

use core::{cmp::Reverse, net::IpAddr, time::Duration};
use std::{
    collections::HashMap,
    sync::{Arc, Mutex, MutexGuard},
    time::Instant,
};
use tokio::{
    sync::{OwnedSemaphorePermit, Semaphore},
    task::AbortHandle,
    time::timeout,
};

/// Connections at once: at least, and at most, however many descriptors there are.
const RANGE: [usize; 2] = [4, 256];
/// One of so many free descriptors is for connections; all others are in reserve.
const SHARE: usize = 4;
/// One of so many connections is for the same peer.
const PEER_SHARE: usize = 2;
/// The time for which a connection waits for its next request, or takes to read an answer.
const IDLE_MAX: Duration = Duration::from_secs(120);
/// The time after which another connection is looked for that makes room.
const PATIENCE: Duration = Duration::from_millis(100);

const HELD_SHORTLY: &str = "nothing panics while it holds the connections";

/// All that are open.
#[derive(Debug)]
pub(super) struct Connections {
    permits: Arc<Semaphore>,
    per_peer: usize,
    table: Mutex<Table>,
}

#[derive(Debug, Default)]
struct Table {
    count: u64,
    open: HashMap<u64, Connection>,
}

/// A connection that is open.
#[derive(Debug)]
struct Connection {
    peer: IpAddr,
    /// The time of its last answer; none while a request is being answered.
    idle_since: Option<Instant>,
    /// Whether a request of it was granted.
    is_known: bool,
    task: Option<AbortHandle>,
}

/// The place of one connection, free again when it is dropped.
#[derive(Debug)]
pub(super) struct Place {
    id: u64,
    connections: Arc<Connections>,
    _permit: OwnedSemaphorePermit,
}

impl Connections {
    /// As many as the limit of descriptors allows.
    pub(super) fn new() -> Self {
        Self::at_most(free_descriptors().map_or(RANGE[1], |free| (free / SHARE).clamp(RANGE[0], RANGE[1])))
    }

    fn at_most(count: usize) -> Self {
        let permits = Arc::new(Semaphore::new(count));
        Self { permits, per_peer: (count / PEER_SHARE).max(1), table: Mutex::default() }
    }

    /// A place for a connection of a peer. If there is none, the connection that has been idle for longest makes room; if
    /// none is idle, this waits. None if the peer has as many as it may, and all of them are being answered.
    pub(super) async fn place(self: &Arc<Self>, peer: IpAddr) -> Option<Place> {
        let peer = peer.to_canonical();
        if self.count_of(peer) >= self.per_peer {
            if !self.close_idlest(|connection| connection.peer == peer) {
                return None;
            }
        } else if self.permits.available_permits() == 0 {
            self.close_idlest(|_| true);
        }
        let permit = loop {
            match timeout(PATIENCE, self.permits.clone().acquire_owned()).await {
                Ok(permit) => break permit.ok()?,
                Err(_) => drop(self.close_idlest(|_| true)),
            }
        };
        let mut table = self.lock();
        table.count += 1;
        let id = table.count;
        let connection = Connection { peer, idle_since: Some(Instant::now()), is_known: false, task: None };
        table.open.insert(id, connection);
        drop(table);
        Some(Place { id, connections: self.clone(), _permit: permit })
    }

    /// Closes the connections that have been idle for too long.
    pub(super) fn close_stale(&self) {
        let is_stale = |connection: &Connection| connection.idle_since.is_some_and(|since| since.elapsed() > IDLE_MAX);
        self.lock()
            .open
            .extract_if(|_, connection| is_stale(connection))
            .for_each(|(_, connection)| connection.close());
    }

    /// Closes one of the idle connections that `may` holds for, if there is one: first those without a granted request, of
    /// these the ones of the peer with most connections, of these the oldest.
    fn close_idlest(&self, may: impl Fn(&Connection) -> bool) -> bool {
        let mut table = self.lock();
        let mut counts: HashMap<IpAddr, usize> = HashMap::new();
        for connection in table.open.values() {
            *counts.entry(connection.peer).or_default() += 1;
        }
        let rank = |connection: &Connection| {
            let since = connection.idle_since.filter(|_| may(connection))?;
            Some((connection.is_known, Reverse(counts[&connection.peer]), since))
        };
        let ranks = table.open.iter().filter_map(|(id, connection)| Some((rank(connection)?, *id)));
        let Some((_, id)) = ranks.min() else { return false };
        let closed = table.open.remove(&id);
        drop(table);
        closed.into_iter().for_each(Connection::close);
        true
    }

    fn count_of(&self, peer: IpAddr) -> usize {
        self.lock().open.values().filter(|connection| connection.peer == peer).count()
    }

    fn change(&self, id: u64, change: impl FnOnce(&mut Connection)) {
        if let Some(connection) = self.lock().open.get_mut(&id) {
            change(connection);
        }
    }

    fn lock(&self) -> MutexGuard<'_, Table> {
        self.table.lock().expect(HELD_SHORTLY)
    }
}

impl Connection {
    fn close(self) {
        self.task.into_iter().for_each(|task| task.abort());
    }
}

impl Place {
    /// Says which task closes the connection when it is aborted.
    pub(super) fn belongs_to(&self, task: AbortHandle) {
        self.connections.change(self.id, |connection| connection.task = Some(task));
    }

    /// A request is being answered from now on.
    pub(super) fn begin(&self) {
        self.connections.change(self.id, |connection| connection.idle_since = None);
    }

    /// The request was answered, and granted or not.
    pub(super) fn end(&self, is_granted: bool) {
        self.connections.change(self.id, |connection| {
            connection.idle_since = Some(Instant::now());
            connection.is_known |= is_granted;
        });
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        self.connections.lock().open.remove(&self.id);
    }
}

/// Descriptors that this process may still open; none where the system sets no limit.
#[cfg(unix)]
fn free_descriptors() -> Option<usize> {
    use rustix::process::{Resource, getrlimit};
    let limit = usize::try_from(getrlimit(Resource::Nofile).current?).ok()?;
    let open = std::fs::read_dir("/dev/fd").map_or(0, Iterator::count);
    Some(limit.saturating_sub(open))
}

#[cfg(not(unix))]
fn free_descriptors() -> Option<usize> {
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::{future::pending, net::Ipv4Addr};
    use tokio::runtime::{Builder, Runtime};

    const NEAR: IpAddr = IpAddr::V4(Ipv4Addr::LOCALHOST);
    const FAR: IpAddr = IpAddr::V4(Ipv4Addr::new(192, 168, 0, 2));

    fn runtime() -> Runtime {
        Builder::new_current_thread().enable_time().build().unwrap()
    }

    /// Holds a place until it is closed; what came of its requests so far is in `granted`.
    async fn connect(connections: &Arc<Connections>, peer: IpAddr, granted: Option<bool>) -> Option<u64> {
        let place = Arc::new(connections.place(peer).await?);
        let (id, held) = (place.id, place.clone());
        place.belongs_to(
            tokio::spawn(async move {
                pending::<()>().await;
                drop(held);
            })
            .abort_handle(),
        );
        place.begin();
        granted.into_iter().for_each(|granted| place.end(granted));
        Some(id)
    }

    fn open(connections: &Connections) -> Vec<u64> {
        let mut ids: Vec<u64> = connections.lock().open.keys().copied().collect();
        ids.sort_unstable();
        ids
    }

    #[test]
    fn the_oldest_idle_connection_makes_room_and_known_ones_stay_longest() {
        runtime().block_on(async {
            let connections = Arc::new(Connections::at_most(4));
            for (peer, granted) in [(NEAR, true), (FAR, false), (FAR, false), (NEAR, false)] {
                connect(&connections, peer, Some(granted)).await.unwrap();
            }
            let third = IpAddr::V4(Ipv4Addr::new(10, 0, 0, 1));
            connect(&connections, third, Some(false)).await.unwrap();
            assert_eq!(open(&connections), [1, 3, 4, 5], "the oldest of those without a granted request");
            for _ in 0..9 {
                connect(&connections, third, Some(false)).await.unwrap();
            }
            assert!(open(&connections).contains(&1), "one that is known stays");
        });
    }

    #[test]
    fn a_peer_has_no_more_than_its_share_and_takes_nothing_from_others() {
        runtime().block_on(async {
            let connections = Arc::new(Connections::at_most(8));
            connect(&connections, FAR, Some(false)).await.unwrap();
            for _ in 0..20 {
                connect(&connections, NEAR, Some(true)).await.unwrap();
            }
            assert_eq!((connections.count_of(FAR), connections.count_of(NEAR)), (1, 4));
            let mapped = IpAddr::V6(Ipv4Addr::LOCALHOST.to_ipv6_mapped());
            for _ in 0..4 {
                connect(&connections, NEAR, None).await.unwrap();
            }
            assert_eq!(connect(&connections, mapped, None).await, None, "all of the peer are being answered");
            assert!(connect(&connections, FAR, None).await.is_some(), "another peer is served");
        });
    }

    #[test]
    fn most_descriptors_are_in_reserve() {
        let connections = Connections::new().permits.available_permits();
        assert!((RANGE[0]..=RANGE[1]).contains(&connections), "{connections}");
        assert!(free_descriptors().is_none_or(|free| connections <= (free / 2).max(RANGE[0])), "{connections}");
    }
}
