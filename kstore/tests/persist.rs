//! The store's file: what comes back, what happens to damaged, foreign, newer and full files.
#![allow(clippy::disallowed_methods, clippy::print_stdout, reason = "tests touch the disk and say what they skip")]

mod common;

use common::{Folder, config, see, tree, with_end, zone};
use std::path::Path;
use tsense_kstore::persist::{FileFault, Loaded, Room, Vault, history_of, read_only};
use tsense_kstore::{Config, KnowledgeStore, Snapshot, View, Zone};

/// A store of three trees written in three commits; the states after each.
fn three_commits(path: &Path) -> (Vault, Vec<KnowledgeStore>) {
    let (mut vault, loaded) = Vault::open(path, &config()).unwrap();
    let mut store = loaded.into_store(config());
    let mut states = Vec::new();
    for i in 0..3 {
        let trees: Vec<_> = (0..=i).map(|n| tree(5.0 * f64::from(n), 0.0)).collect();
        see(&mut store, f64::from(i) * 2.0, &trees);
        vault.commit(zone(), &store.take_changes()).unwrap();
        states.push(store.clone());
    }
    (vault, states)
}

fn same(loaded: &Loaded, store: &KnowledgeStore) -> bool {
    loaded.objects.iter().eq(store.objects()) && loaded.next_id >= store.next_id()
}

#[test]
fn everything_comes_back_after_a_clean_end_and_the_file_is_a_single_one() {
    let folder = Folder::new();
    let (vault, states) = three_commits(&folder.file());
    vault.close().unwrap();
    assert!(!with_end(&folder.file(), "-wal").exists());
    let (_vault, loaded) = Vault::open(&folder.file(), &config()).unwrap();
    assert_eq!(loaded.objects.len(), 3);
    assert!(loaded.objects.iter().eq(states[2].objects()) && loaded.next_id >= 4);
    assert_eq!((loaded.zone, loaded.notes), (Some(zone()), vec![]));
}

#[test]
fn removed_objects_stay_removed_and_their_ids_are_not_given_again() {
    let folder = Folder::new();
    let (mut vault, mut states) = three_commits(&folder.file());
    let mut store = states.pop().unwrap();
    assert_eq!(store.forget(common::at(1e10)), 3);
    vault.commit(zone(), &store.take_changes()).unwrap();
    drop(vault);
    let (_vault, loaded) = Vault::open(&folder.file(), &config()).unwrap();
    assert!(loaded.objects.is_empty());
    assert!(loaded.next_id >= 4);
}

/// The log of a running store, cut at any byte, and flipped at any byte: the store is one of its states, never less
/// than what a whole log before the cut holds, and never something else.
#[test]
fn a_log_cut_at_any_byte_leaves_one_of_the_states() {
    let folder = Folder::new();
    let (vault, states) = three_commits(&folder.file());
    let main = std::fs::read(folder.file()).unwrap();
    let wal = std::fs::read(with_end(&folder.file(), "-wal")).unwrap();
    drop(vault);
    assert!(wal.len() > 4096, "no log to cut");
    let (mut cases, mut seen) = (0, [0; 4]);
    for cut in (0..=wal.len()).step_by(509).chain([wal.len()]) {
        let copy = Folder::new();
        std::fs::write(copy.file(), &main).unwrap();
        std::fs::write(with_end(&copy.file(), "-wal"), &wal[..cut]).unwrap();
        let (_vault, loaded) = Vault::open(&copy.file(), &config()).unwrap();
        assert_eq!(loaded.notes, Vec::<String>::new(), "cut at {cut}");
        let state = states.iter().rposition(|s| same(&loaded, s));
        assert!(state.is_some() || loaded.objects.is_empty(), "cut at {cut}: {:?}", loaded.objects);
        seen[state.map_or(0, |s| s + 1)] += 1;
        cases += 1;
    }
    assert!(cases > 50 && seen.iter().all(|n| *n > 0), "{cases} cuts, states {seen:?}");
}

#[test]
fn a_file_damaged_anywhere_is_read_or_set_aside_and_never_deleted() {
    let folder = Folder::new();
    let (vault, _) = three_commits(&folder.file());
    vault.close().unwrap();
    let whole = std::fs::read(folder.file()).unwrap();
    let (mut read, mut set_aside) = (0, 0);
    for at in (0..whole.len()).step_by(whole.len() / 60) {
        for truncated in [true, false] {
            let copy = Folder::new();
            let mut damaged = whole.clone();
            if truncated {
                damaged.truncate(at);
            } else {
                let end = (at + 64).min(damaged.len());
                damaged[at..end].fill(0xa5);
            }
            std::fs::write(copy.file(), &damaged).unwrap();
            let (_vault, loaded) = Vault::open(&copy.file(), &config()).unwrap_or_else(|e| panic!("{e}"));
            let kept = copy.0.join("objects.damaged-1.gpkg");
            if kept.exists() {
                assert!(std::fs::read(&kept).unwrap() == damaged, "changed while it was set aside");
                assert!(loaded.notes[0].contains("objects.damaged-1.gpkg"), "{:?}", loaded.notes);
                assert!(loaded.objects.is_empty());
                set_aside += 1;
            } else {
                read += 1;
            }
        }
    }
    assert!(read > 0 && set_aside > 10 && read + set_aside >= 120, "{read} read, {set_aside} set aside");
}

#[test]
fn ids_go_on_after_a_damaged_file_was_set_aside_and_the_new_store_works() {
    let folder = Folder::new();
    drop(three_commits(&folder.file()));
    std::fs::write(folder.file(), vec![b'x'; 5000]).unwrap();
    let (mut vault, loaded) = Vault::open(&folder.file(), &config()).unwrap();
    assert!(loaded.notes[0].contains("damaged"), "{:?}", loaded.notes);
    assert!(loaded.next_id >= 4, "{}", loaded.next_id);
    let mut store = loaded.into_store(config());
    see(&mut store, 100.0, &[tree(0.0, 0.0)]);
    vault.commit(zone(), &store.take_changes()).unwrap();
    drop(vault);
    let (_vault, loaded) = Vault::open(&folder.file(), &config()).unwrap();
    assert_eq!((loaded.objects.len(), loaded.notes.len()), (1, 0));
}

#[test]
fn a_full_disk_is_said_so_and_the_changes_are_written_when_there_is_room_again() {
    let folder = Folder::new();
    let (mut vault, mut states) = three_commits(&folder.file());
    let mut store = states.pop().unwrap();
    let many: Vec<_> = (0..1000).map(|i| tree(3.0 * f64::from(i % 34), 20.0 + 3.0 * f64::from(i / 34))).collect();
    see(&mut store, 20.0, &many);
    let changes = store.take_changes();
    vault.limit_pages(40);
    let fault = vault.commit(zone(), &changes).unwrap_err();
    assert!(matches!(fault, FileFault::DiskFull { .. }), "{fault}");
    assert_eq!(read_only(&folder.file()).unwrap().objects.len(), 3);
    vault.limit_pages(100_000);
    store.give_back(&changes);
    vault.commit(zone(), &store.take_changes()).unwrap();
    assert_eq!(read_only(&folder.file()).unwrap().objects.len(), 1003);
}

#[test]
fn a_second_writer_is_refused_and_readers_are_not() {
    let folder = Folder::new();
    let (_vault, _) = three_commits(&folder.file());
    let fault = Vault::open(&folder.file(), &config()).err().unwrap();
    assert!(matches!(fault, FileFault::Busy { .. }), "{fault}");
    assert_eq!(read_only(&folder.file()).unwrap().objects.len(), 3);
}

#[test]
fn a_folder_that_cannot_be_made_and_a_file_that_cannot_be_written_are_named_with_the_remedy() {
    let fault = Vault::open(Path::new("/proc/tsense/objects.gpkg"), &config()).err().unwrap();
    assert!(matches!(fault, FileFault::NotWritable { .. }), "{fault}");
    assert!(fault.to_string().contains("/proc/tsense/objects.gpkg") && fault.to_string().contains("kstore.file"));

    let folder = Folder::new();
    three_commits(&folder.file()).0.close().unwrap();
    let mut permissions = std::fs::metadata(folder.file()).unwrap().permissions();
    permissions.set_readonly(true);
    std::fs::set_permissions(folder.file(), permissions).unwrap();
    if std::fs::OpenOptions::new().append(true).open(folder.file()).is_ok() {
        println!("SKIPPED: the second half, this user may write to read-only files");
        return;
    }
    let fault = Vault::open(&folder.file(), &config()).err().unwrap();
    assert!(matches!(fault, FileFault::NotWritable { .. }), "{fault}");
    assert_eq!(read_only(&folder.file()).unwrap().objects.len(), 3);
}

#[test]
fn a_newer_layout_is_refused_and_left_alone() {
    let folder = Folder::new();
    three_commits(&folder.file()).0.close().unwrap();
    let connection = rusqlite::Connection::open(folder.file()).unwrap();
    connection.execute("UPDATE kstore SET value = '3' WHERE key = 'layout'", []).unwrap();
    drop(connection);
    let fault = Vault::open(&folder.file(), &config()).err().unwrap();
    assert!(matches!(fault, FileFault::TooNew { .. }), "{fault}");
    assert!(folder.file().exists());
}

#[test]
fn the_file_is_a_geopackage_of_points_in_the_stores_zone() {
    let folder = Folder::new();
    three_commits(&folder.file()).0.close().unwrap();
    let connection = rusqlite::Connection::open(folder.file()).unwrap();
    let number = |sql: &str| connection.query_row(sql, [], |row| row.get::<_, i64>(0)).unwrap();
    assert_eq!(number("PRAGMA application_id"), 0x4750_4b47);
    assert_eq!(number("PRAGMA user_version"), 10_400);
    assert_eq!(number("SELECT count(*) FROM rtree_objects_geom"), 3);
    assert_eq!(number("SELECT srs_id FROM gpkg_contents WHERE table_name = 'objects'"), 32_617);
    assert_eq!(number("SELECT max_x > 500009.9 AND max_x < 500010.1 FROM gpkg_contents WHERE table_name='objects'"), 1);
    let gpkg = geopackage::GeoPackage::open_read_only(folder.file()).unwrap();
    let findings = gpkg.validate().unwrap();
    assert!(findings.is_empty(), "{findings:?}");
}

#[test]
fn a_store_that_moves_to_the_next_zone_takes_its_file_along() {
    let folder = Folder::new();
    let (mut vault, mut states) = three_commits(&folder.file());
    let mut store = states.pop().unwrap();
    let next = Zone::from_epsg(32_618).unwrap();
    let snapshot = Snapshot { stamp: common::at(10.0), vehicle_m: [0.0, 0.0], zone: next, epoch: 1 };
    store.take(&snapshot, &[], |_| View::Unseen);
    vault.commit(next, &store.take_changes()).unwrap();
    vault.close().unwrap();
    let (_vault, loaded) = Vault::open(&folder.file(), &config()).unwrap();
    assert!(same(&loaded, &store) && loaded.zone == Some(next), "{loaded:?}");
    let gpkg = geopackage::GeoPackage::open_read_only(folder.file()).unwrap();
    let findings = gpkg.validate().unwrap();
    assert!(findings.is_empty(), "{findings:?}");
}

#[test]
fn rows_that_make_no_sense_are_left_out_and_said_so() {
    let folder = Folder::new();
    three_commits(&folder.file()).0.close().unwrap();
    let gpkg = geopackage::GeoPackage::open(folder.file()).unwrap();
    gpkg.connection().execute("UPDATE objects SET class = 'dragon' WHERE id = 2", []).unwrap();
    drop(gpkg);
    let (_vault, loaded) = Vault::open(&folder.file(), &config()).unwrap();
    assert_eq!(loaded.objects.iter().map(|o| o.id).collect::<Vec<_>>(), vec![1, 3]);
    assert!(loaded.notes[0].contains("1 objects make no sense"), "{:?}", loaded.notes);
}

fn reasons(path: &Path, id: u64) -> Vec<String> {
    history_of(path, id).unwrap().into_iter().map(|e| e.reason).collect()
}

#[test]
fn the_history_of_an_object_tells_what_became_of_it_and_survives_it() {
    let folder = Folder::new();
    let (mut vault, mut states) = three_commits(&folder.file());
    let mut store = states.pop().unwrap();
    for i in 3..6 {
        see(&mut store, 2.0 * f64::from(i), &[tree(0.0, 0.0)]);
    }
    vault.commit(zone(), &store.take_changes()).unwrap();
    assert_eq!(reasons(&folder.file(), 1), ["first seen", "reported"]);
    assert_eq!(reasons(&folder.file(), 3), ["first seen"]);
    store.forget(common::at(1e10));
    vault.commit(zone(), &store.take_changes()).unwrap();
    assert_eq!(reasons(&folder.file(), 1), ["first seen", "reported", "faded"]);
    let first = &history_of(&folder.file(), 1).unwrap()[0];
    assert_eq!((first.stamp, first.epsg, first.sightings), (common::at(0.0), 32_617, 1));
    assert_eq!(reasons(&folder.file(), 99), Vec::<String>::new());
}

#[test]
fn the_history_is_bounded_for_each_object_and_in_all() {
    let folder = Folder::new();
    let config = Config { history_per_object_max: 3, history_max: 20, ..config() };
    let (mut vault, loaded) = Vault::open(&folder.file(), &config).unwrap();
    let mut store = loaded.into_store(config);
    // One tree is believed and doubted in turn, ten times.
    for round in 0..10 {
        for i in 0..5 {
            see(&mut store, 1e7 * f64::from(round) + 2.0 * f64::from(i), &[tree(0.0, 0.0)]);
        }
        vault.commit(zone(), &store.take_changes()).unwrap();
        store.forget(common::at(1e7 * f64::from(round) + 8e6));
        vault.commit(zone(), &store.take_changes()).unwrap();
    }
    assert_eq!(reasons(&folder.file(), 1), ["no longer reported", "reported", "no longer reported"]);
    let many: Vec<_> = (0..30).map(|i| tree(3.0 * f64::from(i), 20.0)).collect();
    see(&mut store, 1e8, &many);
    vault.commit(zone(), &store.take_changes()).unwrap();
    let connection = rusqlite::Connection::open(folder.file()).unwrap();
    let rows: i64 = connection.query_row("SELECT count(*) FROM history", [], |row| row.get(0)).unwrap();
    assert_eq!(rows, 20);
}

/// A reader that keeps the log from being written back must not cost what was acknowledged.
#[test]
fn a_reader_that_looks_on_while_the_store_ends_loses_nothing() {
    let folder = Folder::new();
    let (mut vault, mut states) = three_commits(&folder.file());
    let reader = rusqlite::Connection::open(folder.file()).unwrap();
    reader.execute_batch("BEGIN").unwrap();
    let seen =
        |c: &rusqlite::Connection| c.query_row("SELECT count(*) FROM objects", [], |r| r.get::<_, i64>(0)).unwrap();
    assert_eq!(seen(&reader), 3);
    let mut store = states.pop().unwrap();
    see(&mut store, 20.0, &[tree(20.0, 0.0), tree(25.0, 0.0)]);
    vault.commit(zone(), &store.take_changes()).unwrap();
    vault.close().unwrap();
    assert_eq!(seen(&reader), 3, "the reader sees the instant it began at");
    reader.execute_batch("COMMIT").unwrap();
    assert_eq!(seen(&reader), 5);
    drop(reader);
    let (_vault, loaded) = Vault::open(&folder.file(), &config()).unwrap();
    assert_eq!((loaded.objects.len(), loaded.notes), (5, vec![]));
}

#[test]
fn a_file_near_its_largest_size_gives_up_history_and_then_the_least_confident() {
    let folder = Folder::new();
    let config = Config { file_max_mb: 1, ..config() };
    let (mut vault, loaded) = Vault::open(&folder.file(), &config).unwrap();
    let mut store = loaded.into_store(config);
    let sure: Vec<_> = (0..100).map(|i| tree(f64::from(i), -50.0)).collect();
    (0..5).for_each(|i| see(&mut store, 2.0 * f64::from(i), &sure));
    for batch in 0..50 {
        let trees: Vec<_> = (0..80).map(|i| tree(f64::from(i), f64::from(batch))).collect();
        see(&mut store, 20.0 + f64::from(batch), &trees);
        if vault.commit(zone(), &store.take_changes()).unwrap() == Room::Little {
            store.make_room();
        }
    }
    vault.close().unwrap();
    let bytes = std::fs::metadata(folder.file()).unwrap().len();
    let dropped = store.dropped().file_full;
    println!("{bytes} bytes, {} objects kept, {dropped} dropped", store.len());
    assert!(bytes <= 1_000_000 && dropped > 100 && store.len() > 500, "{bytes} bytes, {dropped} dropped");
    assert!((1..=100).all(|id| store.get(id).is_some()), "one that was sure was dropped");
}

#[test]
fn a_file_of_the_layout_before_gets_a_history_and_keeps_its_objects() {
    let folder = Folder::new();
    three_commits(&folder.file()).0.close().unwrap();
    let connection = rusqlite::Connection::open(folder.file()).unwrap();
    let old = "DROP TABLE history; DROP TABLE layer_styles; \
               DELETE FROM gpkg_contents WHERE table_name IN ('history', 'layer_styles'); \
               UPDATE kstore SET value = '1' WHERE key = 'layout'";
    connection.execute_batch(old).unwrap();
    drop(connection);
    assert_eq!(reasons(&folder.file(), 1), Vec::<String>::new());
    let (mut vault, loaded) = Vault::open(&folder.file(), &config()).unwrap();
    let mut store = loaded.into_store(config());
    see(&mut store, 20.0, &[tree(20.0, 0.0)]);
    vault.commit(zone(), &store.take_changes()).unwrap();
    assert_eq!((store.len(), reasons(&folder.file(), store.next_id() - 1)), (4, vec!["first seen".to_owned()]));
    vault.close().unwrap();
    let findings = geopackage::GeoPackage::open_read_only(folder.file()).unwrap().validate().unwrap();
    assert!(findings.is_empty(), "{findings:?}");
}
