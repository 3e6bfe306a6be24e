//! Answers to requests: which are allowed, and with which files.

use std::{
    fs::{self, File},
    net::IpAddr,
    path::{Component, Path, PathBuf},
};

use super::{
    http::{Answer, Body, Request},
    listing,
};

/// What is served.
#[derive(Debug)]
pub(super) struct Site {
    /// The folder of the page's files.
    pub(super) page: PathBuf,
    /// The canonical path of the folder with scenes.
    pub(super) folder: PathBuf,
}

/// What tells the page that it is served.
const MARK: &str = "<meta name=\"gs-serve\" content=\"1\">\n</head>";

/// Content-security policy: scripts and images from this server only; no embedding.
const POLICY: &str = "default-src 'self'; script-src 'self' 'wasm-unsafe-eval'; style-src 'self' 'unsafe-inline'; \
                      img-src 'self' data: blob:; connect-src 'self' data:; frame-ancestors 'none'";

/// Headers of every answer. The last three make the page cross-origin isolated, so that its engine may have
/// threads.
const HEADERS: [(&str, &str); 7] = [
    ("Cache-Control", "no-store"),
    ("X-Content-Type-Options", "nosniff"),
    ("Content-Security-Policy", POLICY),
    ("Referrer-Policy", "no-referrer"),
    ("Cross-Origin-Opener-Policy", "same-origin"),
    ("Cross-Origin-Embedder-Policy", "require-corp"),
    ("Cross-Origin-Resource-Policy", "same-origin"),
];

const KINDS: [(&str, &str); 5] = [
    ("html", "text/html; charset=utf-8"),
    ("js", "text/javascript; charset=utf-8"),
    ("css", "text/css; charset=utf-8"),
    ("wasm", "application/wasm"),
    ("json", "application/json"),
];

impl Site {
    pub(super) fn answer(&self, request: &Request<'_>) -> Answer {
        let path = request.target.split('?').next().unwrap_or_default();
        let found = check(request).and_then(|()| self.content(path));
        let (status, kind, body) = match found {
            Ok((kind, body)) => ("200 OK", kind, body),
            Err((status, text)) => (status, "text/plain; charset=utf-8", Body::Bytes(text.as_bytes().to_vec())),
        };
        Answer { status, headers: [("Content-Type", kind)].into_iter().chain(HEADERS).collect(), body }
    }

    /// The kind and the content of what a path names.
    fn content(&self, path: &str) -> Result<(&'static str, Body), Refusal> {
        let path = gs_io::percent_decoded(path).ok_or(("400 Bad Request", "the path is not readable"))?;
        if path == "/serve/list" {
            let list = serde_json::to_vec(&listing::of(&self.folder)).unwrap_or_default();
            return Ok(("application/json", Body::Bytes(list)));
        }
        if let Some(file) = path.strip_prefix("/serve/file/") {
            let file = File::open(inside(&self.folder, file)?).map_err(|_| NOT_FOUND)?;
            let length = file.metadata().map_err(|_| NOT_FOUND)?.len();
            return Ok(("application/octet-stream", Body::File(file, length)));
        }
        let name = if path == "/" { "index.html" } else { path.trim_start_matches('/') };
        let file = inside(&self.page, name)?;
        let ending = file.extension().unwrap_or_default();
        let kind = KINDS.iter().find(|(known, _)| ending == *known).ok_or(NOT_FOUND)?.1;
        let mut bytes = fs::read(&file).map_err(|_| NOT_FOUND)?;
        if name == "index.html" {
            bytes = String::from_utf8_lossy(&bytes).replacen("</head>", MARK, 1).into_bytes();
        }
        Ok((kind, Body::Bytes(bytes)))
    }
}

/// Status and text.
type Refusal = (&'static str, &'static str);

const NOT_FOUND: Refusal = ("404 Not Found", "there is no such file in the folder");

/// Whether a request is one of the page's own.
///
/// A site elsewhere that resolves its name to this machine sends that name as Host, and one that
/// sends requests across sends its Origin.
fn check(request: &Request<'_>) -> Result<(), Refusal> {
    if !["GET", "HEAD"].contains(&request.method) {
        return Err(("405 Method Not Allowed", "only GET is answered"));
    }
    let host = request.header("Host").unwrap_or_default();
    if !is_address(host) {
        return Err(("403 Forbidden", "the Host header names neither localhost nor an address"));
    }
    match request.header("Origin") {
        Some(origin) if origin.strip_prefix("http://") != Some(host) => {
            Err(("403 Forbidden", "the request comes from another site"))
        }
        _ => Ok(()),
    }
}

/// Whether a host, with its port, is localhost or an address rather than a name.
fn is_address(host: &str) -> bool {
    let name = match host.rsplit_once(':') {
        Some((name, port)) if port.bytes().all(|byte| byte.is_ascii_digit()) => name,
        _ => host,
    };
    let bare = name.strip_prefix('[').and_then(|name| name.strip_suffix(']')).unwrap_or(name);
    name.eq_ignore_ascii_case("localhost") || bare.parse::<IpAddr>().is_ok()
}

/// The file with this name in a folder or below, also where a link leads out of it.
fn inside(folder: &Path, name: &str) -> Result<PathBuf, Refusal> {
    let plain = Path::new(name).components().all(|part| matches!(part, Component::Normal(_)));
    if !plain || name.is_empty() || name.contains(['\0', '\\']) {
        return Err(NOT_FOUND);
    }
    let (root, file) = (folder.canonicalize(), folder.join(name).canonicalize());
    match (root, file) {
        (Ok(root), Ok(file)) if file.starts_with(&root) && file.is_file() => Ok(file),
        _ => Err(NOT_FOUND),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn site() -> (tempfile::TempDir, Site) {
        let place = tempfile::tempdir().unwrap();
        let path = |name: &str| place.path().join(name);
        fs::create_dir_all(path("page")).unwrap();
        fs::create_dir_all(path("scenes/a b")).unwrap();
        fs::write(path("page/index.html"), "<head></head>").unwrap();
        fs::write(path("page/secret.txt"), "not a file of the page").unwrap();
        fs::write(path("scenes/a b/ü.ply"), "ply").unwrap();
        fs::write(path("outside.ply"), "outside").unwrap();
        let site = Site { page: path("page"), folder: path("scenes").canonicalize().unwrap() };
        (place, site)
    }

    fn answer(site: &Site, method: &str, target: &str, headers: &[(&str, &str)]) -> Answer {
        let headers: Vec<_> =
            headers.iter().map(|&(name, value)| httparse::Header { name, value: value.as_bytes() }).collect();
        site.answer(&Request { method, target, headers: &headers })
    }

    fn status(site: &Site, path: &str, headers: &[(&str, &str)]) -> u16 {
        answer(site, "GET", path, headers).status[..3].parse().unwrap()
    }

    #[test]
    fn files_of_the_folder_are_read_and_no_others() {
        let (place, site) = site();
        let get = |path: &str| status(&site, path, &[("host", "localhost:7860")]);
        assert_eq!([get("/"), get("/index.html"), get("/serve/list"), get("/serve/file/a%20b/%C3%BC.ply")], [200; 4]);
        for path in [
            "/serve/file/../outside.ply",
            "/serve/file/%2e%2e/outside.ply",
            "/serve/file/a%20b/..%2f..%2foutside.ply",
            "/serve/file//etc/passwd",
            "/serve/file/%2fetc%2fpasswd",
            "/serve/file/..%5coutside.ply",
            "/serve/file/",
            "/serve/file/a%20b",
            "/secret.txt",
            "/../outside.ply",
            "/absent.js",
        ] {
            assert_eq!(get(path), 404, "{path}");
        }
        assert_eq!(get("/serve/file/%zz"), 400);
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(place.path().join("outside.ply"), place.path().join("scenes/link.ply")).unwrap();
            assert_eq!(get("/serve/file/link.ply"), 404);
        }
        drop(place);
    }

    #[test]
    fn every_answer_lets_the_page_have_threads() {
        let (_place, site) = site();
        for path in ["/", "/serve/list", "/absent.js"] {
            let answer = answer(&site, "GET", path, &[("host", "localhost")]);
            for header in [
                ("Cross-Origin-Opener-Policy", "same-origin"),
                ("Cross-Origin-Embedder-Policy", "require-corp"),
                ("Cross-Origin-Resource-Policy", "same-origin"),
            ] {
                assert!(answer.headers.contains(&header), "{path}: {header:?}");
            }
        }
    }

    #[test]
    fn requests_of_other_sites_are_refused() {
        let (_place, site) = site();
        for host in ["localhost", "LOCALHOST:1", "127.0.0.1:7860", "[::1]:7860", "192.168.1.2:7860"] {
            assert_eq!(status(&site, "/", &[("host", host)]), 200, "{host}");
        }
        for host in ["evil.example", "localhost.evil.example:7860", "127.0.0.1.evil.example", ""] {
            assert_eq!(status(&site, "/", &[("host", host)]), 403, "{host}");
        }
        assert_eq!(status(&site, "/", &[]), 403);
        let from = |origin: &str| status(&site, "/serve/list", &[("host", "localhost:7860"), ("origin", origin)]);
        assert_eq!(from("http://localhost:7860"), 200);
        for origin in ["http://evil.example", "null", "https://localhost:7860", "http://localhost:1"] {
            assert_eq!(from(origin), 403, "{origin}");
        }
        assert!(answer(&site, "POST", "/", &[("host", "localhost")]).status.starts_with("405"));
    }
}
