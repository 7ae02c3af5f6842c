//! No wrong map is called good: drawn scenes with exact poses.
//!
//! `VOLERY_LONG=1` runs twelve seeds of each trial instead of one.

use rayon::prelude::*;
use volery_tests::trials::{Outcome, Trial, run};

fn seeds() -> std::ops::Range<u64> {
    if std::env::var_os("VOLERY_LONG").is_some() { 0..12 } else { 0..1 }
}

#[test]
fn no_wrong_map_is_called_good() {
    let cases: Vec<(Trial, u64)> =
        Trial::ALL.into_iter().flat_map(|trial| seeds().map(move |seed| (trial, seed))).collect();
    let outcomes: Vec<Outcome> = cases.par_iter().map(|&(trial, seed)| run(trial, seed)).collect();
    let mut wrong_but_good = Vec::new();
    let (mut num_right, mut num_doubted) = (0, 0);
    for ((trial, seed), outcome) in cases.iter().zip(&outcomes) {
        let quality = &outcome.reconstruction.quality;
        let codes: Vec<_> = quality.reasons.iter().map(|reason| &reason.code).collect();
        let told = outcome.figures.map_or("no map".to_owned(), |figures| figures.to_string());
        let line = format!(
            "{trial:?} {seed}: extent {:.2}, {told}, {} {:?} {codes:?}",
            outcome.extent,
            if outcome.is_wrong() { "wrong" } else { "right" },
            quality.verdict
        );
        println!("{line}");
        match (outcome.is_wrong(), outcome.is_called_good()) {
            (true, true) => wrong_but_good.push(line),
            (false, is_called_good) if trial.is_well_flown() => {
                num_right += 1;
                num_doubted += usize::from(!is_called_good);
            }
            _ => {}
        }
    }
    println!("{num_doubted} of {num_right} right maps of well flown scans are not called good");
    assert!(wrong_but_good.is_empty(), "{}", wrong_but_good.join("\n"));
    assert!(3 * num_right > cases.len(), "the trials are to be mapped");
    assert!(10 * num_doubted <= num_right, "{num_doubted} of {num_right} right maps are doubted");
}

/// Opposite walls that look alike, folded onto each other: next to nothing contradicts, but images
/// in one place do not show the same.
#[test]
fn a_folded_room_is_named() {
    let outcome = run(Trial::Doppelganger, 5);
    assert!(outcome.is_wrong(), "the room is to be folded");
    let reasons = &outcome.reconstruction.quality.reasons;
    assert!(reasons.iter().any(|reason| reason.code == "merged_places"), "{reasons:?}");
}
