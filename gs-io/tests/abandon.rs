//! A program that exits during a write leaves no temporary file. The test has a process of its own,
//! because nothing can be written afterwards.

use std::{fs, sync::mpsc, thread, time::Duration};

#[test]
fn an_abandoned_write_leaves_the_old_file_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a");
    gs_io::write_atomically(&path, |file| file.write_all(b"old")).unwrap();
    let names = || -> Vec<_> { fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name()).collect() };

    let (begun, wait_until_begun) = mpsc::channel();
    let (go_on, wait_to_go_on) = mpsc::channel::<()>();
    let (ended, wait_until_ended) = mpsc::channel();
    let target = path.clone();
    thread::spawn(move || {
        let _ = gs_io::write_atomically(&target, |file| {
            file.write_all(&[0; 100_000])?;
            begun.send(()).unwrap();
            wait_to_go_on.recv().unwrap();
            file.write_all(b"the rest")
        });
        ended.send(()).unwrap();
    });
    wait_until_begun.recv().unwrap();
    assert_eq!(names().len(), 2, "the write is under way");

    gs_io::abandon_writes();
    assert_eq!(names(), ["a"]);
    go_on.send(()).unwrap();
    assert!(wait_until_ended.recv_timeout(Duration::from_millis(300)).is_err(), "the write never returns");
    assert_eq!(names(), ["a"]);
    assert_eq!(fs::read(&path).unwrap(), b"old");
}
