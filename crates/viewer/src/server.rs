//! HTTP server: accepts connections within their limits and serves requests on them.

use crate::{
    ViewerError,
    connections::{Connections, Slot},
    routes::{Authorised, router},
    state::ServerState,
};
use axum::Router;
use core::{net::SocketAddr, time::Duration};
use hyper::{
    body::Incoming,
    server::conn::http1,
    service::{Service, service_fn},
};
use hyper_util::{
    rt::{TokioIo, TokioTimer},
    service::TowerToHyperService,
};
use std::{io, sync::Arc};
use tokio::net::{TcpListener, TcpStream};

/// Interval of checks for a stop and for stale connections.
const POLL_INTERVAL: Duration = Duration::from_millis(100);
/// Maximum time for the headers of a request, from the start of the connection or its last
/// response.
const HEADERS_TIMEOUT: Duration = Duration::from_secs(15);
/// Largest size of the headers of a request, in bytes.
const HEADERS_MAX: usize = 16 << 10;
/// Pause after the system has no descriptor or memory for another connection.
const ACCEPT_PAUSE: Duration = Duration::from_millis(500);

/// Binds an address; port 0 selects any free port.
pub(crate) async fn listen(address: SocketAddr) -> Result<TcpListener, ViewerError> {
    TcpListener::bind(address).await.map_err(|cause| ViewerError::Listen { address, cause })
}

/// Serves until `is_stopped` returns true.
pub(crate) async fn serve(
    listener: TcpListener,
    state: Arc<ServerState>,
    is_stopped: impl Fn() -> bool,
) -> Result<(), ViewerError> {
    let connections = Arc::new(Connections::new());
    let server = tokio::spawn(accept(listener, connections.clone(), router(state)));
    while !is_stopped() && !server.is_finished() {
        connections.close_stale();
        tokio::time::sleep(POLL_INTERVAL).await;
    }
    if !server.is_finished() {
        server.abort();
        return Ok(());
    }
    server.await.map_err(ViewerError::Ended)
}

/// Accepts connections in an endless loop.
async fn accept(listener: TcpListener, connections: Arc<Connections>, router: Router) {
    loop {
        let (stream, peer) = match listener.accept().await {
            Ok(connection) => connection,
            Err(error) if is_of_connection(&error) => continue,
            Err(_) => {
                tokio::time::sleep(ACCEPT_PAUSE).await;
                continue;
            }
        };
        let Some(slot) = connections.acquire(peer.ip()).await else { continue };
        let slot = Arc::new(slot);
        slot.set_task(tokio::spawn(serve_connection(stream, slot.clone(), router.clone())).abort_handle());
    }
}

/// True if an error is due to a closed connection, not to the system.
fn is_of_connection(error: &io::Error) -> bool {
    use io::ErrorKind::{ConnectionAborted, ConnectionRefused, ConnectionReset};
    matches!(error.kind(), ConnectionAborted | ConnectionRefused | ConnectionReset)
}

/// Serves the requests of a connection. The stream is dropped before the slot, so a free slot
/// implies a free descriptor.
async fn serve_connection(stream: TcpStream, slot: Arc<Slot>, router: Router) {
    let router = TowerToHyperService::new(router);
    let service = service_fn(|request: hyper::Request<Incoming>| {
        slot.begin_request();
        let response = router.call(request);
        let slot = &slot;
        async move {
            let response = response.await;
            let is_authorised =
                response.as_ref().is_ok_and(|response| response.extensions().get::<Authorised>().is_some());
            slot.end_request(is_authorised);
            response
        }
    });
    let mut http = http1::Builder::new();
    http.timer(TokioTimer::new()).header_read_timeout(HEADERS_TIMEOUT).max_buf_size(HEADERS_MAX);
    // Errors of broken connections are ignored.
    let _ = http.serve_connection(TokioIo::new(stream), service).await;
}
