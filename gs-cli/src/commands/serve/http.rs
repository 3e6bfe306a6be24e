//! HTTP/1.1, as far as a browser needs it to read files: GET and HEAD, one request per connection.

use std::{
    fs::File,
    io::{self, Read, Write},
    net::{Shutdown, TcpListener, TcpStream},
    sync::atomic::{AtomicUsize, Ordering},
    thread,
    time::{Duration, Instant},
};

/// Largest head of a request, in bytes.
const MAX_HEAD: usize = 16 << 10;

/// Largest number of headers of a request.
const MAX_HEADERS: usize = 100;

/// Time within which a request must be complete, and within which each part of an answer must be taken.
const PATIENCE: Duration = Duration::from_secs(30);

/// Time that a browser has to close a connection after its answer.
const FAREWELL: Duration = Duration::from_secs(1);

/// Most connections at a time; what comes beyond them is closed. Browsers open about six each.
const MAX_CONNECTIONS: usize = 64;

/// The head of a request.
#[derive(Debug, Clone, Copy)]
pub(super) struct Request<'a> {
    pub(super) method: &'a str,
    /// As it was sent: with percent signs and the part after `?`.
    pub(super) target: &'a str,
    pub(super) headers: &'a [httparse::Header<'a>],
}

impl<'a> Request<'a> {
    /// The value of a header by its name in any case; an empty text where it is not UTF-8.
    pub(super) fn header(&self, name: &str) -> Option<&'a str> {
        let header = self.headers.iter().find(|header| header.name.eq_ignore_ascii_case(name))?;
        Some(std::str::from_utf8(header.value).unwrap_or_default().trim())
    }
}

/// What an answer contains.
#[derive(Debug)]
pub(super) enum Body {
    Bytes(Vec<u8>),
    /// A file and the number of bytes to send of it.
    File(File, u64),
}

/// The answer to a request.
#[derive(Debug)]
pub(super) struct Answer {
    /// Status and reason, such as `200 OK`.
    pub(super) status: &'static str,
    pub(super) headers: Vec<(&'static str, &'static str)>,
    pub(super) body: Body,
}

/// Answers requests, each connection on a thread of its own, until the program ends.
pub(super) fn serve(listener: &TcpListener, answer: impl Fn(&Request<'_>) -> Answer + Sync) {
    let (open, answer) = (AtomicUsize::new(0), &answer);
    thread::scope(|scope| {
        loop {
            // A connection that fails before it is accepted is no reason to end; nor are too many open files.
            let Ok((stream, _)) = listener.accept() else {
                thread::sleep(Duration::from_millis(50));
                continue;
            };
            let Some(counted) = Counted::new(&open) else { continue };
            // Where no thread can be started, this closes the connection.
            let _started = thread::Builder::new().spawn_scoped(scope, move || {
                let _counted = counted;
                // A browser may close a connection at any time.
                let _closed = converse(stream, answer);
            });
        }
    });
}

/// One of the open connections, until it is dropped: also if the thread that answers panics.
struct Counted<'a>(&'a AtomicUsize);

impl<'a> Counted<'a> {
    /// Counts one more connection, unless there are [`MAX_CONNECTIONS`].
    fn new(open: &'a AtomicUsize) -> Option<Self> {
        let counted = Self(open);
        (open.fetch_add(1, Ordering::Relaxed) < MAX_CONNECTIONS).then_some(counted)
    }
}

impl Drop for Counted<'_> {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::Relaxed);
    }
}

/// Reads one request and answers it.
fn converse(mut stream: TcpStream, answer: &(impl Fn(&Request<'_>) -> Answer + Sync)) -> io::Result<()> {
    stream.set_nodelay(true)?;
    stream.set_write_timeout(Some(PATIENCE))?;
    let head = read_head(&stream)?;
    let mut headers = [httparse::EMPTY_HEADER; MAX_HEADERS];
    let mut parsed = httparse::Request::new(&mut headers);
    let is_complete = parsed.parse(&head).is_ok_and(|status| status.is_complete());
    let (answer, with_body) = match parsed {
        httparse::Request { method: Some(method), path: Some(target), headers, .. } if is_complete => {
            (answer(&Request { method, target, headers }), method != "HEAD")
        }
        _ => (Answer { status: "400 Bad Request", headers: Vec::new(), body: Body::Bytes(Vec::new()) }, true),
    };
    send(&mut stream, answer, with_body)?;
    // If something unread were left, closing would discard what the browser has not yet taken.
    stream.shutdown(Shutdown::Write)?;
    io::copy(&mut Timed::new(&stream, FAREWELL), &mut io::sink()).map(drop)
}

/// Reads until a deadline, however small the parts are that arrive before.
struct Timed<'a> {
    stream: &'a TcpStream,
    deadline: Instant,
}

impl<'a> Timed<'a> {
    fn new(stream: &'a TcpStream, patience: Duration) -> Self {
        Self { stream, deadline: Instant::now() + patience }
    }
}

impl Read for Timed<'_> {
    fn read(&mut self, part: &mut [u8]) -> io::Result<usize> {
        let left = self.deadline.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Err(io::ErrorKind::TimedOut.into());
        }
        self.stream.set_read_timeout(Some(left))?;
        self.stream.read(part)
    }
}

/// What was sent up to the end of the headers, or less if that doesn't come within [`MAX_HEAD`].
fn read_head(stream: &TcpStream) -> io::Result<Vec<u8>> {
    let (mut stream, mut head) = (Timed::new(stream, PATIENCE), Vec::new());
    let mut part = [0; 2048];
    while head.len() < MAX_HEAD {
        let count = stream.read(&mut part)?;
        // The end may have come in two parts.
        let searched = head.len().saturating_sub(3);
        head.extend(&part[..count]);
        if count == 0 || head[searched..].windows(4).any(|window| window == b"\r\n\r\n") {
            break;
        }
    }
    Ok(head)
}

fn send(stream: &mut TcpStream, answer: Answer, with_body: bool) -> io::Result<()> {
    let Answer { status, headers, body } = answer;
    let length = match &body {
        Body::Bytes(bytes) => bytes.len() as u64,
        Body::File(_, length) => *length,
    };
    let mut head = format!("HTTP/1.1 {status}\r\nContent-Length: {length}\r\nConnection: close\r\n");
    for (name, value) in headers {
        head += &format!("{name}: {value}\r\n");
    }
    stream.write_all(format!("{head}\r\n").as_bytes())?;
    match body {
        _ if !with_body => Ok(()),
        Body::Bytes(bytes) => stream.write_all(&bytes),
        // A file may grow while it is sent.
        Body::File(file, length) => io::copy(&mut file.take(length), stream).map(drop),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The answer to these bytes by a server that says what it was asked.
    fn answered(parts: &[&[u8]]) -> String {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let mut client = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        let (stream, _) = listener.accept().unwrap();
        let echo = |request: &Request<'_>| Answer {
            status: "200 OK",
            headers: vec![("X-Kind", "echo")],
            body: Body::Bytes(format!("{} {:?}", request.target, request.header("HOST")).into_bytes()),
        };
        thread::scope(|scope| {
            scope.spawn(move || converse(stream, &echo));
            for part in parts {
                client.write_all(part).unwrap();
            }
            client.shutdown(Shutdown::Write).unwrap();
            let mut text = String::new();
            client.read_to_string(&mut text).unwrap();
            text
        })
    }

    #[test]
    fn requests_are_answered_however_they_are_cut() {
        let whole = b"GET /a?b HTTP/1.1\r\nHost: here\r\n\r\n";
        let expected = "HTTP/1.1 200 OK\r\nContent-Length: 17\r\nConnection: close\r\nX-Kind: echo\r\n\r\n\
                        /a?b Some(\"here\")";
        assert_eq!(answered(&[whole]), expected);
        for cut in [1, 20, whole.len() - 3, whole.len() - 1] {
            let (first, second) = whole.split_at(cut);
            assert_eq!(answered(&[first, second]), expected, "{cut}");
        }
        let head = answered(&[b"HEAD /a?b HTTP/1.1\r\nHost: here\r\n\r\n"]);
        assert!(head.starts_with("HTTP/1.1 200 OK\r\nContent-Length: 17") && head.ends_with("\r\n\r\n"), "{head}");
    }

    #[test]
    fn malformed_requests_are_refused() {
        for bytes in [&b""[..], b"GET / HTTP/1.1\r\nHost: h", b"\x16\x03\x01\x02\r\n\r\n", b"GET / HTTP/9\r\n\r\n"] {
            assert!(answered(&[bytes]).starts_with("HTTP/1.1 400"), "{bytes:?}");
        }
        let many: String = (0..200).map(|i| format!("H{i}: v\r\n")).collect();
        assert!(answered(&[format!("GET / HTTP/1.1\r\n{many}\r\n").as_bytes()]).starts_with("HTTP/1.1 400"));
    }

    #[test]
    fn connections_whose_answer_panics_are_no_longer_counted() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        thread::spawn(move || {
            serve(&listener, |request| {
                assert_ne!(request.target, "/fault");
                Answer { status: "200 OK", headers: Vec::new(), body: Body::Bytes(Vec::new()) }
            });
        });
        let asked = |target: &str| {
            let mut client = TcpStream::connect(address).unwrap();
            client.write_all(format!("GET {target} HTTP/1.1\r\n\r\n").as_bytes()).unwrap();
            let mut text = String::new();
            client.read_to_string(&mut text).map(|_| text)
        };
        for _ in 0..MAX_CONNECTIONS {
            assert_eq!(asked("/fault").unwrap_or_default(), "");
        }
        // The last thread may still be ending.
        assert!((0..100).any(|_| {
            thread::sleep(Duration::from_millis(20));
            asked("/").unwrap_or_default().starts_with("HTTP/1.1 200")
        }));
    }

    #[test]
    fn a_client_that_sends_on_slowly_is_left_after_its_answer() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let mut client = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        let (stream, _) = listener.accept().unwrap();
        let nothing = |_: &Request<'_>| Answer { status: "200 OK", headers: Vec::new(), body: Body::Bytes(Vec::new()) };
        let conversation = thread::spawn(move || converse(stream, &nothing));
        client.write_all(b"GET / HTTP/1.1\r\n\r\n").unwrap();
        let start = Instant::now();
        while !conversation.is_finished() && start.elapsed() < 10 * FAREWELL {
            // Its end refuses what is still sent.
            let _refused = client.write_all(b"x");
            thread::sleep(FAREWELL / 10);
        }
        assert!(conversation.is_finished(), "still there after {:?}", start.elapsed());
    }
}
