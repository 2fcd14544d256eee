//! Connection limits: number of open connections, and eviction of idle ones. Most file descriptors
//! stay free for the rest of the process, so that clients cannot make a training fail.

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

/// Smallest and largest limit of connections, for any number of descriptors.
const LIMITS: [usize; 2] = [4, 256];
/// Free descriptors for each connection.
const DESCRIPTORS_PER_CONNECTION: usize = 4;
/// Connections for each connection of one peer.
const CONNECTIONS_PER_PEER_CONNECTION: usize = 2;
/// Maximum time between two requests of a connection, and for reading a response.
const IDLE_MAX: Duration = Duration::from_secs(120);
/// Interval of attempts to evict a connection while none is idle.
const EVICTION_INTERVAL: Duration = Duration::from_millis(100);

const NO_POISON: &str = "nothing panics under the lock of the connections";

/// Open connections.
#[derive(Debug)]
pub(crate) struct Connections {
    permits: Arc<Semaphore>,
    per_peer: usize,
    table: Mutex<Table>,
}

#[derive(Debug, Default)]
struct Table {
    count: u64,
    open: HashMap<u64, Connection>,
}

/// Open connection.
#[derive(Debug)]
struct Connection {
    peer: IpAddr,
    /// Time of the last response; `None` while a request is processed.
    idle_since: Option<Instant>,
    /// Whether one of its requests was authorised.
    is_authorised: bool,
    task: Option<AbortHandle>,
}

/// Slot of one connection, free again when it is dropped.
#[derive(Debug)]
pub(crate) struct Slot {
    id: u64,
    connections: Arc<Connections>,
    _permit: OwnedSemaphorePermit,
}

impl Connections {
    /// Limit of connections by the free file descriptors of the process.
    pub(crate) fn new() -> Self {
        Self::at_most(limit_for(free_descriptors()))
    }

    fn at_most(count: usize) -> Self {
        let permits = Arc::new(Semaphore::new(count));
        Self { permits, per_peer: (count / CONNECTIONS_PER_PEER_CONNECTION).max(1), table: Mutex::default() }
    }

    /// Acquires a slot for a connection of a peer. Without a free slot, closes an idle connection,
    /// or waits for one. Returns `None` if the peer has reached its limit and all of its
    /// connections are processing requests.
    pub(crate) async fn acquire(self: &Arc<Self>, peer: IpAddr) -> Option<Slot> {
        let peer = peer.to_canonical();
        if self.count_of(peer) >= self.per_peer {
            if !self.close_idlest(|connection| connection.peer == peer) {
                return None;
            }
        } else if self.permits.available_permits() == 0 {
            self.close_idlest(|_| true);
        }
        let permit = loop {
            match timeout(EVICTION_INTERVAL, self.permits.clone().acquire_owned()).await {
                Ok(permit) => break permit.ok()?,
                Err(_) => drop(self.close_idlest(|_| true)),
            }
        };
        let mut table = self.lock();
        table.count += 1;
        let id = table.count;
        let connection = Connection { peer, idle_since: Some(Instant::now()), is_authorised: false, task: None };
        table.open.insert(id, connection);
        drop(table);
        Some(Slot { id, connections: self.clone(), _permit: permit })
    }

    /// Closes connections that have been idle for longer than [`IDLE_MAX`].
    pub(crate) fn close_stale(&self) {
        let is_stale = |connection: &Connection| connection.idle_since.is_some_and(|since| since.elapsed() > IDLE_MAX);
        self.lock()
            .open
            .extract_if(|_, connection| is_stale(connection))
            .for_each(|(_, connection)| connection.close());
    }

    /// Closes one idle connection among those that `may` accepts: first those without an authorised
    /// request, then of the peer with most connections, then the longest idle. Returns true if one
    /// was closed.
    fn close_idlest(&self, may: impl Fn(&Connection) -> bool) -> bool {
        let mut table = self.lock();
        let mut counts: HashMap<IpAddr, usize> = HashMap::new();
        for connection in table.open.values() {
            *counts.entry(connection.peer).or_default() += 1;
        }
        let rank = |connection: &Connection| {
            let since = connection.idle_since.filter(|_| may(connection))?;
            Some((connection.is_authorised, Reverse(counts[&connection.peer]), since))
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
        self.table.lock().expect(NO_POISON)
    }
}

impl Connection {
    fn close(self) {
        self.task.into_iter().for_each(|task| task.abort());
    }
}

impl Slot {
    /// Sets the task of the connection, which is aborted to close it.
    pub(crate) fn set_task(&self, task: AbortHandle) {
        self.connections.change(self.id, |connection| connection.task = Some(task));
    }

    /// Marks the start of a request.
    pub(crate) fn begin_request(&self) {
        self.connections.change(self.id, |connection| connection.idle_since = None);
    }

    /// Marks the end of a request, and whether it was authorised.
    pub(crate) fn end_request(&self, is_authorised: bool) {
        self.connections.change(self.id, |connection| {
            connection.idle_since = Some(Instant::now());
            connection.is_authorised |= is_authorised;
        });
    }
}

impl Drop for Slot {
    fn drop(&mut self) {
        self.connections.lock().open.remove(&self.id);
    }
}

fn limit_for(free_descriptors: Option<usize>) -> usize {
    let [least, most] = LIMITS;
    free_descriptors.map_or(most, |free| (free / DESCRIPTORS_PER_CONNECTION).clamp(least, most))
}

/// File descriptors that the process may still open; none if the system sets no limit.
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

    /// Holds a slot until its connection is closed. `authorised` tells of its last request; none
    /// where one is being processed.
    async fn connect(connections: &Arc<Connections>, peer: IpAddr, authorised: Option<bool>) -> Option<u64> {
        let slot = Arc::new(connections.acquire(peer).await?);
        let (id, held) = (slot.id, slot.clone());
        slot.set_task(
            tokio::spawn(async move {
                pending::<()>().await;
                drop(held);
            })
            .abort_handle(),
        );
        slot.begin_request();
        authorised.into_iter().for_each(|authorised| slot.end_request(authorised));
        Some(id)
    }

    fn open(connections: &Connections) -> Vec<u64> {
        let mut ids: Vec<u64> = connections.lock().open.keys().copied().collect();
        ids.sort_unstable();
        ids
    }

    #[test]
    fn the_oldest_idle_connection_is_evicted_and_authorised_ones_last() {
        runtime().block_on(async {
            let connections = Arc::new(Connections::at_most(4));
            for (peer, authorised) in [(NEAR, true), (FAR, false), (FAR, false), (NEAR, false)] {
                connect(&connections, peer, Some(authorised)).await.unwrap();
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
    fn a_peer_has_a_limited_share_of_connections() {
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
    fn most_descriptors_are_reserved() {
        let connections = Connections::new().permits.available_permits();
        assert!((LIMITS[0]..=LIMITS[1]).contains(&connections), "{connections}");
        assert!(free_descriptors().is_none_or(|free| connections <= (free / 2).max(LIMITS[0])), "{connections}");
    }
}
