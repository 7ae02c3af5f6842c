//! `volery doctor`: is this machine fit, is a server, and are the drones?

mod drones;

use std::path::Path;

use serde::Serialize;
use volery_client::Client;
use volery_pipeline::PipelineError;

use crate::{
    args::DoctorArgs,
    output::{Ending, Outcome, print_json},
    serve::{mavlink_key, own_program, runtime},
};

/// Less memory than this makes maps of hundreds of photos fail, MiB.
const MIN_MEMORY_MIB: u64 = 2048;

/// Free room for photos and maps, MiB: well above the reserve at which the server refuses uploads.
const MIN_DISK_MIB: u64 = 2048;

#[derive(Debug, Serialize)]
struct Check {
    name: &'static str,
    ok: bool,
    detail: String,
}

pub(crate) fn run(args: &DoctorArgs, json: bool) -> Outcome {
    let mut checks = vec![program()?, cores(), simd(), memory(), disk(&args.data)];
    if let Some(server) = &args.server {
        checks.extend(runtime()?.block_on(server_checks(server, args.token.as_deref())));
    }
    if let Some(listen) = args.mavlink {
        let key = args.mavlink_key.as_deref().map(mavlink_key).transpose()?;
        checks.extend(drones::checks(listen, key));
    }
    if json {
        print_json(&checks);
    } else {
        for check in &checks {
            let mark = if check.ok { "ok " } else { "BAD" };
            println!("{mark} {:12} {}", check.name, check.detail);
        }
    }
    Ok(if checks.iter().all(|check| check.ok) { Ending::Done } else { Ending::Partial })
}

fn program() -> Result<Check, PipelineError> {
    let detail = format!("volery {}, {}", env!("CARGO_PKG_VERSION"), own_program()?.display());
    Ok(Check { name: "program", ok: true, detail })
}

fn cores() -> Check {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    Check { name: "cores", ok: true, detail: cores.to_string() }
}

fn simd() -> Check {
    #[cfg(target_arch = "x86_64")]
    let (ok, detail) = {
        let vnni = std::arch::is_x86_feature_detected!("avx512vnni");
        let avx2 = std::arch::is_x86_feature_detected!("avx2");
        (
            vnni || avx2,
            if vnni {
                "AVX-512 VNNI"
            } else if avx2 {
                "AVX2"
            } else {
                "none: slow"
            },
        )
    };
    #[cfg(not(target_arch = "x86_64"))]
    let (ok, detail) = (true, "portable code");
    Check { name: "vector unit", ok, detail: detail.to_owned() }
}

fn memory() -> Check {
    let text = std::fs::read_to_string("/proc/meminfo").unwrap_or_default();
    let line = text.lines().find_map(|line| line.strip_prefix("MemAvailable:"));
    let kib = line.and_then(|line| line.split_whitespace().next()?.parse::<u64>().ok());
    match kib.map(|kib| kib / 1024) {
        Some(mib) => Check {
            name: "memory",
            ok: mib >= MIN_MEMORY_MIB,
            detail: format!("{mib} MiB available, {MIN_MEMORY_MIB} wanted"),
        },
        None => Check { name: "memory", ok: true, detail: "unknown".to_owned() },
    }
}

fn disk(folder: &Path) -> Check {
    match rustix::fs::statvfs(folder) {
        Ok(stat) => {
            let mib = stat.f_bavail.saturating_mul(stat.f_frsize) >> 20;
            Check {
                name: "disk",
                ok: mib >= MIN_DISK_MIB,
                detail: format!("{mib} MiB free at {}, {MIN_DISK_MIB} wanted", folder.display()),
            }
        }
        Err(error) => {
            let detail = format!("{}: {error}", folder.display());
            Check { name: "disk", ok: false, detail }
        }
    }
}

async fn server_checks(server: &str, token: Option<&str>) -> Vec<Check> {
    let client = match Client::new(server, token) {
        Ok(client) => client,
        Err(error) => {
            return vec![Check { name: "server", ok: false, detail: error.to_string() }];
        }
    };
    let mut checks = match client.ready().await {
        Ok(health) => health
            .checks
            .into_iter()
            .map(|check| Check {
                name: "server part",
                ok: check.ok,
                detail: format!("{} {}", check.name, check.detail.unwrap_or_default()),
            })
            .collect(),
        Err(error) => vec![Check { name: "server", ok: false, detail: error.to_string() }],
    };
    checks.push(match client.info().await {
        Ok(info) => Check {
            name: "server",
            ok: true,
            detail: format!("volery {} at {server}, API {}", info.version, info.api),
        },
        Err(error) => Check { name: "server", ok: false, detail: error.to_string() },
    });
    checks
}
