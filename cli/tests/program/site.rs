//! The program as a server, and requests as plain as they come.

use assert_cmd::cargo::cargo_bin;
use core::time::Duration;
use serde_json::Value;
use std::{
    io::{BufRead, BufReader, Read, Write},
    net::{Shutdown, TcpStream},
    path::Path,
    process::{Child, ChildStdout, Command, Stdio},
};

/// Longest time for an answer.
const PATIENCE: Duration = Duration::from_secs(60);

/// The same command, in a process that may open no more descriptors than this.
#[cfg(unix)]
pub(crate) fn with_descriptors(command: &Command, limit: usize) -> Command {
    let mut limited = Command::new("sh");
    limited.args(["-c", &format!("ulimit -n {limit}; exec \"$@\""), "sh"]);
    limited.arg(command.get_program()).args(command.get_args());
    limited
}

/// Connections that keep a server busy: unfinished headers, nothing at all, slow bodies, garbage,
/// headers without end, and some of which one half is closed.
pub(crate) fn crowd(port: u16, count: usize) -> Vec<TcpStream> {
    let long = format!("GET / HTTP/1.1\r\nhost: localhost\r\nx: {}", "x".repeat(100_000));
    let slow = "POST /light?name=a.hdr HTTP/1.1\r\nhost: localhost\r\ncontent-length: 1000000\r\n\r\n#?RADIANCE";
    let words = ["GET / HTTP/1.1\r\nhost: loc", "", slow, "\x01\x02\x03\r\n\r\n", &long, "GET /frame"];
    let connect = |index: usize| {
        let mut stream = TcpStream::connect(("127.0.0.1", port)).unwrap();
        // A server that refuses to listen is none the worse for it.
        let _ = stream.write_all(words[index % words.len()].as_bytes());
        if index % words.len() == words.len() - 1 {
            let _ = stream.shutdown(Shutdown::Write);
        }
        stream
    };
    (0..count).map(connect).collect()
}

/// A server that ends when it is dropped.
pub(crate) struct Site {
    child: Child,
    /// Stays open: what is written later has to go somewhere.
    _output: BufReader<ChildStdout>,
    /// Printed address, including the fragment behind `#`.
    pub(crate) url: String,
    pub(crate) port: u16,
}

impl Site {
    /// `specula view` of a scene, at a port that is free.
    pub(crate) fn of(model: &Path, words: &[&str]) -> Self {
        let mut command = Command::new(cargo_bin!("specula"));
        command.arg("view").arg(model).args(["--executor", "cpu"]).args(words);
        if !words.contains(&"--listen") {
            command.args(["--listen", "0"]);
        }
        Self::started(command)
    }

    /// Any command that prints an address first.
    pub(crate) fn started(mut command: Command) -> Self {
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
        let mut url = String::new();
        let mut output = BufReader::new(child.stdout.take().unwrap());
        output.read_line(&mut url).unwrap();
        let url = url.trim().to_owned();
        let port = url.trim_start_matches("http://").split([':', '/']).nth(1).and_then(|port| port.parse().ok());
        let port = port.unwrap_or_else(|| panic!("{url:?} is no address"));
        Self { child, _output: output, url, port }
    }

    /// Waits until it ends by itself.
    pub(crate) fn ended(mut self) -> Option<i32> {
        self.child.wait().unwrap().code()
    }

    pub(crate) fn id(&self) -> u32 {
        self.child.id()
    }

    /// Request with default headers.
    pub(crate) fn get(&self, path: &str) -> Answer {
        request(self.port, "GET", path, &[], &[])
    }

    pub(crate) fn post(&self, path: &str, body: &[u8]) -> Answer {
        request(self.port, "POST", path, &[], body)
    }

    /// With other headers; `host` instead of the default one.
    pub(crate) fn get_as(&self, path: &str, headers: &[(&str, &str)]) -> Answer {
        request(self.port, "GET", path, headers, &[])
    }
}

impl Drop for Site {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Response of a server.
#[derive(Debug)]
pub(crate) struct Answer {
    pub(crate) status: u16,
    pub(crate) head: String,
    pub(crate) body: Vec<u8>,
}

impl Answer {
    pub(crate) fn text(&self) -> String {
        String::from_utf8_lossy(&self.body).into_owned()
    }

    pub(crate) fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap_or_else(|error| panic!("{error}: {}", self.text()))
    }

    /// Red, green, blue of each pixel, and the size.
    pub(crate) fn picture(&self) -> image::RgbImage {
        assert_eq!(self.status, 200, "{}", self.text());
        image::load_from_memory(&self.body).unwrap().to_rgb8()
    }
}

/// A connection with a request on it.
pub(crate) fn sent(port: u16, method: &str, path: &str, headers: &[(&str, &str)], body: &[u8]) -> TcpStream {
    let mut stream = TcpStream::connect(("127.0.0.1", port)).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    let host = headers.iter().find(|(name, _)| *name == "host").map_or("localhost", |(_, host)| host);
    let mut head = format!("{method} {path} HTTP/1.1\r\nhost: {host}\r\nconnection: close\r\n");
    for (name, word) in headers.iter().filter(|(name, _)| *name != "host") {
        head += &format!("{name}: {word}\r\n");
    }
    head += &format!("content-length: {}\r\n\r\n", body.len());
    stream.write_all(head.as_bytes()).unwrap();
    // A server that refuses a body need not read it.
    let _ = stream.write_all(body);
    stream
}

/// One request, one answer; its status is 0 where the connection was closed without one.
pub(crate) fn request(port: u16, method: &str, path: &str, headers: &[(&str, &str)], body: &[u8]) -> Answer {
    let mut stream = sent(port, method, path, headers, body);
    let mut bytes = Vec::new();
    let _ = stream.read_to_end(&mut bytes);
    let Some(split) = bytes.windows(4).position(|four| four == b"\r\n\r\n") else {
        return Answer { status: 0, head: String::new(), body: Vec::new() };
    };
    let head = String::from_utf8_lossy(&bytes[..split]).into_owned();
    let status = head.split(' ').nth(1).unwrap().parse().unwrap();
    let body = &bytes[split + 4..];
    let body = if head.to_lowercase().contains("transfer-encoding: chunked") { unchunked(body) } else { body.to_vec() };
    Answer { status, head, body }
}

fn unchunked(mut bytes: &[u8]) -> Vec<u8> {
    let mut body = Vec::new();
    while let Some(end) = bytes.windows(2).position(|two| two == b"\r\n") {
        let size = usize::from_str_radix(core::str::from_utf8(&bytes[..end]).unwrap(), 16).unwrap();
        body.extend(&bytes[end + 2..end + 2 + size]);
        bytes = &bytes[(end + 4 + size).min(bytes.len())..];
    }
    body
}
