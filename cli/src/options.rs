//! `volery options`.

use volery_api::job_options;

use crate::output::{Ending, Outcome, print_json};

pub(crate) fn run(json: bool) -> Outcome {
    let options = job_options();
    if json {
        print_json(&options);
    } else {
        println!("{:18} {:>8} {:>8} {:>8}  range", "name", "fast", "balanced", "best");
        for option in options {
            let (name, defaults) = (&option.name, option.defaults);
            let (fast, balanced, best) = (defaults.fast, defaults.balanced, defaults.best);
            let (minimum, maximum, unit) = (option.minimum, option.maximum, &option.unit);
            println!(
                "{name:18} {fast:>8} {balanced:>8} {best:>8}  {minimum} to {maximum} {unit}: {}",
                option.description
            );
        }
    }
    Ok(Ending::Done)
}
