//! Where and when the figures were taken.

/// Processor, cores in use and date, one line.
pub(crate) fn description() -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = info
        .lines()
        .find_map(|line| line.strip_prefix("model name"))
        .map_or("unknown processor", |rest| rest.trim_start_matches([' ', '\t', ':']));
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let simd = ["avx512_vnni", "avx512bw", "avx2"].into_iter().find(|flag| info.contains(flag));
    let load = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    let load = load.split_whitespace().next().unwrap_or("unknown").to_owned();
    let date = time::OffsetDateTime::now_utc().date();
    format!(
        "{date}, {model}, {cores} cores, {}, load at the start {load}",
        simd.unwrap_or("no AVX2")
    )
}
