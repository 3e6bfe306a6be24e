//! Answers to requests: which are allowed, and with which files.

use std::{
    fs,
    net::IpAddr,
    path::{Component, Path, PathBuf},
};

use http_body_util::Full;
use hyper::{
    Method, Request, Response, StatusCode,
    body::Bytes,
    header::{self, HeaderValue},
};

use super::listing;

/// What is served.
#[derive(Debug)]
pub(super) struct Site {
    /// The folder of the page's files.
    pub(super) page: PathBuf,
    /// The canonical path of the folder with scenes.
    pub(super) folder: PathBuf,
}

type Answer = Response<Full<Bytes>>;

/// What tells the page that it is served.
const MARK: &str = "<meta name=\"gs-serve\" content=\"1\">\n</head>";

/// Content-security policy: scripts and images from this server only; no embedding.
const POLICY: &str = "default-src 'self'; script-src 'self' 'wasm-unsafe-eval'; style-src 'self' 'unsafe-inline'; \
                      img-src 'self' data: blob:; connect-src 'self' data:; frame-ancestors 'none'";

/// Makes the page cross-origin isolated, so that its engine may have threads.
const ISOLATION: [(&str, &str); 3] = [
    ("cross-origin-opener-policy", "same-origin"),
    ("cross-origin-embedder-policy", "require-corp"),
    ("cross-origin-resource-policy", "same-origin"),
];

const KINDS: [(&str, &str); 5] = [
    ("html", "text/html; charset=utf-8"),
    ("js", "text/javascript; charset=utf-8"),
    ("css", "text/css; charset=utf-8"),
    ("wasm", "application/wasm"),
    ("json", "application/json"),
];

impl Site {
    pub(super) fn answer<B>(&self, request: &Request<B>) -> Answer {
        let found = check(request).and_then(|()| self.content(request.uri().path()));
        let (status, kind, body) = match found {
            Ok((kind, body)) => (StatusCode::OK, kind, body),
            Err((status, text)) => (status, "text/plain; charset=utf-8", text.as_bytes().to_vec()),
        };
        let mut answer = Response::new(Full::new(Bytes::from(body)));
        *answer.status_mut() = status;
        let headers = answer.headers_mut();
        for (name, value) in [
            (header::CONTENT_TYPE, kind),
            (header::CACHE_CONTROL, "no-store"),
            (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
            (header::CONTENT_SECURITY_POLICY, POLICY),
            (header::REFERRER_POLICY, "no-referrer"),
        ] {
            headers.insert(name, HeaderValue::from_static(value));
        }
        for (name, value) in ISOLATION {
            headers.insert(name, HeaderValue::from_static(value));
        }
        answer
    }

    /// The kind and the bytes of what a path names.
    fn content(&self, path: &str) -> Result<(&'static str, Vec<u8>), Refusal> {
        let path = decoded(path).ok_or((StatusCode::BAD_REQUEST, "the path is not readable"))?;
        if path == "/serve/list" {
            let list = serde_json::to_vec(&listing::of(&self.folder)).unwrap_or_default();
            return Ok(("application/json", list));
        }
        if let Some(file) = path.strip_prefix("/serve/file/") {
            let bytes = fs::read(inside(&self.folder, file)?).map_err(|_| NOT_FOUND)?;
            return Ok(("application/octet-stream", bytes));
        }
        let name = if path == "/" { "index.html" } else { path.trim_start_matches('/') };
        let file = inside(&self.page, name)?;
        let ending = file.extension().unwrap_or_default();
        let kind = KINDS.iter().find(|(known, _)| ending == *known).ok_or(NOT_FOUND)?.1;
        let mut bytes = fs::read(&file).map_err(|_| NOT_FOUND)?;
        if name == "index.html" {
            bytes = String::from_utf8_lossy(&bytes).replacen("</head>", MARK, 1).into_bytes();
        }
        Ok((kind, bytes))
    }
}

type Refusal = (StatusCode, &'static str);

const NOT_FOUND: Refusal = (StatusCode::NOT_FOUND, "there is no such file in the folder");

/// Whether a request is one of the page's own.
///
/// A site elsewhere that resolves its name to this machine sends that name as Host, and one that
/// sends requests across sends its Origin.
fn check<B>(request: &Request<B>) -> Result<(), Refusal> {
    if ![Method::GET, Method::HEAD].contains(request.method()) {
        return Err((StatusCode::METHOD_NOT_ALLOWED, "only GET is answered"));
    }
    let text = |name| request.headers().get(name).map(|value: &HeaderValue| value.to_str().unwrap_or_default());
    let host = text(header::HOST).unwrap_or_default();
    if !is_address(host) {
        return Err((StatusCode::FORBIDDEN, "the Host header names neither localhost nor an address"));
    }
    match text(header::ORIGIN) {
        Some(origin) if origin.strip_prefix("http://") != Some(host) => {
            Err((StatusCode::FORBIDDEN, "the request comes from another site"))
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

/// A path without percent signs.
fn decoded(path: &str) -> Option<String> {
    let mut parts = path.split('%');
    let mut bytes = parts.next()?.as_bytes().to_vec();
    for part in parts {
        bytes.push(u8::from_str_radix(part.get(..2)?, 16).ok()?);
        bytes.extend(&part.as_bytes()[2..]);
    }
    String::from_utf8(bytes).ok()
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

    fn status(site: &Site, path: &str, headers: &[(&str, &str)]) -> u16 {
        let mut request = Request::builder().uri(path);
        for (name, value) in headers {
            request = request.header(*name, *value);
        }
        site.answer(&request.body(()).unwrap()).status().as_u16()
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
            let request = Request::builder().uri(path).header("host", "localhost").body(()).unwrap();
            let answer = site.answer(&request);
            let value = |name: &str| answer.headers()[name].to_str().unwrap().to_owned();
            assert_eq!(value("cross-origin-opener-policy"), "same-origin", "{path}");
            assert_eq!(value("cross-origin-embedder-policy"), "require-corp", "{path}");
            assert_eq!(value("cross-origin-resource-policy"), "same-origin", "{path}");
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
        let post = Request::builder().method("POST").uri("/").header("host", "localhost").body(()).unwrap();
        assert_eq!(site.answer(&post).status(), StatusCode::METHOD_NOT_ALLOWED);
    }
}
