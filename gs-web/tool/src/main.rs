//! `gs-web-tool WASM PAGE OUT [THREADED]`: makes the folder of the page from the WebAssembly of gs-web
//! and the files in `gs-web/page`.
//!
//! OUT gets the page's files, the bindings with their types (`gs_web.d.ts`), and `one-file.html`:
//! the same page as a single file, in which `gs page` puts a scene. With THREADED, the WebAssembly
//! for several threads, the folder `threads` in OUT gets that, its bindings and the worker.
//!
//! `gs-web-tool bind WASM OUT NAME`: makes the bindings alone, for the npm package.

mod bundle;

use std::{
    env,
    error::Error,
    fs,
    io::Write,
    path::{Path, PathBuf},
    process::{Command, ExitCode},
};

use base64::{Engine, engine::general_purpose::STANDARD};
use flate2::{Compression, write::GzEncoder};
use wasm_bindgen_cli_support::Bindgen;

type Result<T = (), E = Box<dyn Error>> = std::result::Result<T, E>;

/// The name of the page's bindings.
const NAME: &str = "gs_web";

/// The WebAssembly beside the page.
const WASM: &str = "gs_web_bg.wasm";

/// The modules that run in a worker, beside the bindings.
const WORKER: [&str; 7] =
    ["worker.js", "answer.js", "engine.js", "levels-worker.js", "levels.js", "open-scene.js", "targets.js"];

/// What tells the page that there is an engine with threads.
const MARK: &str = "<meta name=\"gs-threads\" content=\"1\">\n</head>";

/// What wasm-opt may assume of browsers: all of them have had these since 2023.
const FEATURES: [&str; 7] = [
    "--enable-simd",
    "--enable-threads",
    "--enable-bulk-memory",
    "--enable-sign-ext",
    "--enable-mutable-globals",
    "--enable-nontrapping-float-to-int",
    "--enable-reference-types",
];

fn main() -> ExitCode {
    let arguments: Vec<PathBuf> = env::args_os().skip(1).map(PathBuf::from).collect();
    let made = match arguments.as_slice() {
        [bind_only, wasm, out, name] if bind_only == Path::new("bind") => {
            // An instance that has stopped can be replaced.
            bind(Bindgen::new().reset_state_function(true), wasm, out, &name.to_string_lossy(), "-Oz")
        }
        [wasm, page, out, threaded @ ..] => make(wasm, page, out, threaded.first()),
        _ => {
            eprintln!("error: usage: gs-web-tool WASM PAGE OUT [THREADED], or gs-web-tool bind WASM OUT NAME");
            return ExitCode::from(2);
        }
    };
    match made {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn make(wasm: &Path, page: &Path, out: &Path, threaded: Option<&PathBuf>) -> Result {
    bind(&mut Bindgen::new(), wasm, out, NAME, "-O3")?;
    for entry in fs::read_dir(page)? {
        let path = entry?.path();
        if let Some(name) = path.file_name().filter(|_| path.is_file()) {
            fs::copy(&path, out.join(name))?;
        }
    }
    fs::write(out.join("one-file.html"), one_file(out)?)?;
    let threads = out.join("threads");
    // One of an earlier build would have another engine.
    if threads.exists() {
        fs::remove_dir_all(&threads)?;
    }
    let Some(threaded) = threaded else { return Ok(()) };
    bind(&mut Bindgen::new(), threaded, &threads, NAME, "-O3")?;
    for name in WORKER {
        fs::copy(page.join(name), threads.join(name))?;
    }
    let index = out.join("index.html");
    Ok(fs::write(&index, replaced(&fs::read_to_string(&index)?, "</head>", MARK)?)?)
}

/// Writes WebAssembly with its bindings into a folder, under a name, optimized at a level of wasm-opt.
fn bind(bindings: &mut Bindgen, wasm: &Path, out: &Path, name: &str, level: &str) -> Result {
    fs::create_dir_all(out)?;
    bindings.input_path(wasm).out_name(name).web(true)?.typescript(true).generate(out)?;
    optimize(&out.join(format!("{name}_bg.wasm")), level)
}

/// The first wasm-opt that keeps tables of references as they are: version 108 writes a module that
/// does not start.
const LEAST_VERSION: u32 = 117;

/// Runs wasm-opt of binaryen, if it is there and new enough.
fn optimize(wasm: &Path, level: &str) -> Result {
    let version = Command::new("wasm-opt").arg("--version").output().ok().and_then(|output| {
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        text.split_whitespace().find_map(|word| word.parse::<u32>().ok())
    });
    if !version.is_some_and(|version| version >= LEAST_VERSION) {
        let found = version.map_or("isn't there".to_owned(), |version| format!("is of version {version}"));
        println!("wasm-opt {found}: without version {LEAST_VERSION} or later, the page stays a little larger");
        return Ok(());
    }
    let result = wasm.with_extension("optimized");
    let run = Command::new("wasm-opt").args(FEATURES).arg(level).arg(wasm).arg("-o").arg(&result).status()?;
    if run.success() { Ok(fs::rename(result, wasm)?) } else { Err(format!("wasm-opt failed: {run}").into()) }
}

/// The page as a single file: styles, scripts and the WebAssembly, which is compressed, inside.
fn one_file(folder: &Path) -> Result<String> {
    let text = |name: &str| fs::read_to_string(folder.join(name));
    let mut packed = GzEncoder::new(Vec::new(), Compression::best());
    packed.write_all(&fs::read(folder.join(WASM))?)?;
    let wasm = STANDARD.encode(packed.finish()?);
    let worker = bundle::bundled(folder, "worker.js")?;
    let main = bundle::bundled(folder, "main.js")?;
    if worker.contains("</script") || main.contains("</script") {
        return Err("a script of the page contains the end of a script".into());
    }
    let scripts = format!(
        "<!-- scene -->\n<script type=\"text/plain\" id=\"worker-source\">\n{worker}</script>\n\
         <script type=\"text/plain\" id=\"wasm\">{wasm}</script>\n<script type=\"module\">\n{main}</script>"
    );
    let html = replaced(
        &text("index.html")?,
        "<link rel=\"stylesheet\" href=\"style.css\">",
        &format!("<style>\n{}</style>", text("style.css")?),
    )?;
    replaced(&html, "<script type=\"module\" src=\"main.js\"></script>", &scripts)
}

fn replaced(text: &str, from: &str, to: &str) -> Result<String> {
    if text.matches(from).count() != 1 {
        return Err(format!("index.html must have {from} once").into());
    }
    Ok(text.replace(from, to))
}
