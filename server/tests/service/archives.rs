//! Archives that are made to take the memory of whoever opens them.

use crate::support::{Server, photo};
use serde_json::json;
use std::io::{Cursor, Write};
use zip::write::SimpleFileOptions;

const ZIP: [(&str, &str); 1] = [("Content-Type", "application/zip")];

/// The header in a directory of an empty entry `a`.
fn header() -> [u8; 47] {
    let mut header = [0; 47];
    header[..4].copy_from_slice(b"PK\x01\x02");
    header[28] = 1;
    header[46] = b'a';
    header
}

/// The record at the end of an archive.
fn end(entries: u16, directory_bytes: u32, directory_start: u32) -> Vec<u8> {
    let mut end = b"PK\x05\x06\0\0\0\0".to_vec();
    end.extend([entries.to_le_bytes(), entries.to_le_bytes()].concat());
    end.extend([directory_bytes.to_le_bytes(), directory_start.to_le_bytes()].concat());
    end.extend([0, 0]);
    end
}

/// The records with 64 bits, and the one that leads to them.
fn end64(entries: u64, directory_bytes: u64, directory_start: u64) -> Vec<u8> {
    let mut records = b"PK\x06\x06\x2c\0\0\0\0\0\0\0\x2d\0\x2d\0\0\0\0\0\0\0\0\0".to_vec();
    for field in [entries, entries, directory_bytes, directory_start] {
        records.extend(field.to_le_bytes());
    }
    records.extend(b"PK\x06\x07\0\0\0\0");
    records.extend((directory_start + directory_bytes).to_le_bytes());
    records.extend([1, 0, 0, 0]);
    records.extend(end(u16::MAX, u32::MAX, u32::MAX));
    records
}

async fn server_and_set() -> (Server, String) {
    let server = Server::start().await;
    let set = server.client.post("/v1/imagesets", json!({"name": "s"})).await.expect(201).json();
    (server, set["id"].as_str().unwrap().to_owned())
}

#[tokio::test]
async fn a_huge_directory_is_refused_whatever_it_says_of_itself() {
    let (server, set) = server_and_set().await;
    const ENTRIES: u64 = 200_000;
    let directory = header().repeat(ENTRIES as usize);
    let bytes = directory.len() as u64;
    let with = |records: &[u8]| [&directory[..], records].concat();
    for (name, body, code) in [
        ("honest", with(&end64(ENTRIES, bytes, 0)), "too_many_entries"),
        ("few entries, many bytes", with(&end64(1, bytes, 0)), "too_many_entries"),
        ("few entries, many bytes, 32 bits", with(&end(1, bytes as u32, 0)), "too_many_entries"),
        ("65535 entries", with(&end(u16::MAX, 47, 0)), "too_many_entries"),
        (
            "an honest record before one of an entry that is none",
            with(&[end64(ENTRIES, bytes, 0), end(1, 120, 0)].concat()),
            "not_an_archive",
        ),
        ("longer than the file", end(1, 1000, 0), "not_an_archive"),
        ("nothing where the entry is said to be", with(&end(1, 0, 0)), "not_an_archive"),
    ] {
        let path = format!("/v1/imagesets/{set}/archive");
        let refused = server.client.send("POST", &path, &ZIP, &body).await.expect(422);
        assert_eq!(refused.code(), code, "{name}");
    }
    let entries = 10_000_u64;
    let model = [header().repeat(entries as usize), end64(entries, 47 * entries, 0)].concat();
    let path = format!("/v1/imagesets/{set}/model");
    let refused = server.client.send("PUT", &path, &ZIP, &model).await.expect(422);
    assert_eq!(refused.code(), "too_many_entries");
}

/// What is not part of the directory, and what some programs write, does no harm.
#[tokio::test]
async fn archives_in_archives_and_records_of_64_bits_are_read() {
    let (server, set) = server_and_set().await;
    let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
    zip.start_file("a.jpg", SimpleFileOptions::default()).unwrap();
    zip.write_all(&photo("a")).unwrap();
    let inner = zip.finish().unwrap().into_inner();

    let stored = SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
    let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
    zip.set_comment("of a flight").unwrap();
    for (name, bytes) in [("b.jpg", &photo("b")[..]), ("inner.zip", &inner)] {
        zip.start_file(name, stored).unwrap();
        zip.write_all(bytes).unwrap();
    }
    let outer = zip.finish().unwrap().into_inner();

    // The same archive with records of 64 bits, and one behind other bytes.
    let at = inner.windows(4).position(|four| four == b"PK\x05\x06").unwrap();
    let field = |at: usize| u32::from_le_bytes(inner[at..at + 4].try_into().unwrap());
    let (bytes, start) = (field(at + 12), field(at + 16));
    let wide = [&inner[..at], &end64(1, bytes.into(), start.into())].concat();
    let behind = [&b"#!/bin/sh\n"[..], &inner].concat();

    let path = format!("/v1/imagesets/{set}/archive");
    for (body, stored, duplicates) in
        [(&outer, 1, 0), (&inner, 1, 0), (&wide, 0, 1), (&behind, 0, 1)]
    {
        let answer = server.client.send("POST", &path, &ZIP, body).await;
        let report = answer.json();
        let counts = (&report["stored"], &report["duplicates"]);
        assert_eq!(counts, (&json!(stored), &json!(duplicates)), "{report:#}");
    }
}
