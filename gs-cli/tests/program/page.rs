//! `gs page` and `gs serve`, with a page that stands for the real one.

use std::{
    fs,
    io::{BufRead, BufReader, Read, Write},
    net::TcpStream,
    path::Path,
    process::{Child, Stdio},
};

use crate::{
    convert::ply,
    process::{Run, command, folder},
};

const PAGE: &str = "<html><head></head><body>\n<!-- scene -->\n</body></html>\n";

/// A folder with a page, and a scene beside it.
fn place() -> tempfile::TempDir {
    let place = folder();
    fs::create_dir(place.path().join("page")).unwrap();
    for name in ["one-file.html", "index.html"] {
        fs::write(place.path().join("page").join(name), PAGE).unwrap();
    }
    ply(place.path());
    place
}

fn page(place: &Path, scene: &str, output: &str) -> Run {
    let mut page = command();
    page.env("GS_PAGE", place.join("page")).arg("page").arg(place.join(scene)).arg("-o").arg(place.join(output));
    Run::of(&mut page)
}

#[test]
fn a_page_has_the_scene_inside() {
    let place = place();
    page(place.path(), "scene.ply", "a.html").done();
    let text = fs::read_to_string(place.path().join("a.html")).unwrap();
    assert!(text.starts_with("<html>") && text.contains("data-name=\"scene.ply\">cGx5C"), "{text}");
    assert!(!text.contains("<!-- scene -->"), "{text}");
    let other = page(place.path(), "scene.ply", "a.txt");
    assert!(other.status == Some(2) && other.refusal().contains("a page ends in .html"), "{other:?}");
    let absent = page(place.path(), "absent.ply", "b.html");
    assert!(absent.status == Some(1) && absent.refusal().contains("no such file"), "{absent:?}");
}

/// A server, which ends with its test.
struct Server(Child, String);

impl Server {
    fn of(place: &Path) -> Self {
        let mut serve = command();
        serve.env("GS_PAGE", place.join("page")).arg("serve").arg(place).args(["--port", "0"]);
        let mut child = serve.stdout(Stdio::piped()).spawn().unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let address = line.strip_prefix("http://").and_then(|rest| rest.split_once('/')).expect(&line).0.to_owned();
        Self(child, address)
    }

    /// The answer to a request with this Host.
    fn get(&self, path: &str, host: &str) -> String {
        let mut stream = TcpStream::connect(&self.1).unwrap();
        write!(stream, "GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n").unwrap();
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).unwrap();
        String::from_utf8_lossy(&answer).into_owned()
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ended = self.0.kill();
        let _status = self.0.wait();
    }
}

#[test]
fn a_folder_is_served_to_this_machine_alone() {
    let place = place();
    let server = Server::of(place.path());
    assert!(server.1.starts_with("127.0.0.1:"), "{}", server.1);
    let index = server.get("/", &server.1);
    assert!(index.starts_with("HTTP/1.1 200") && index.contains("gs-serve") && index.contains("nosniff"), "{index}");
    let list = server.get("/serve/list", "localhost");
    assert!(list.contains(r#"{"kind":"scene","path":"scene.ply","#), "{list}");
    assert!(server.get("/serve/file/scene.ply", "localhost").contains("\r\n\r\nply\nformat"));
    for (path, host, status) in [
        ("/serve/file/../secret", "localhost", 404),
        ("/serve/file/page/../../etc/passwd", "localhost", 404),
        ("/absent", "localhost", 404),
        ("/", "evil.example", 403),
    ] {
        let answer = server.get(path, host);
        assert!(answer.starts_with(&format!("HTTP/1.1 {status}")), "{path} {host}: {answer}");
    }
}
