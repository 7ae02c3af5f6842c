use volery_geometry::Rng;

use super::*;

fn random_age(rng: &mut Rng) -> Option<Duration> {
    rng.chance(0.95).then(|| Duration::from_secs_f64(rng.uniform().powi(3) * 8.0))
}

fn random_health(rng: &mut Rng) -> Health {
    let mut lasting =
        || if rng.chance(0.6) { Duration::ZERO } else { random_age(rng).unwrap_or_default() };
    let lease_over = lasting();
    Health {
        pose_age: random_age(rng),
        relocating: rng.chance(0.2),
        link_age: random_age(rng),
        lease_over,
        battery: rng.chance(0.7).then(|| rng.uniform()),
    }
}

/// Everything as bad or worse in one respect.
fn worsened(health: &Health, rng: &mut Rng) -> Health {
    let more = Duration::from_secs_f64(rng.uniform() * 4.0);
    let older = |age: Option<Duration>| age.map(|age| age + more);
    let mut worse = *health;
    match rng.index(6) {
        0 => worse.pose_age = older(worse.pose_age),
        1 => worse.relocating = true,
        2 => worse.link_age = older(worse.link_age),
        3 => worse.lease_over += more,
        4 => worse.battery = worse.battery.map(|charge| charge * rng.uniform()),
        _ => (worse.pose_age, worse.link_age) = (None, None),
    }
    worse
}

/// Worse never means milder.
#[test]
fn the_verdict_is_monotone() {
    let limits = WatchdogLimits::default();
    let mut rng = Rng::new(9);
    let mut seen = [0; 3];
    for _ in 0..20_000 {
        let health = random_health(&mut rng);
        let mut before = judge(&health, &limits).severity();
        seen[usize::from(before)] += 1;
        let mut worse = health;
        for _ in 0..4 {
            worse = worsened(&worse, &mut rng);
            let after = judge(&worse, &limits).severity();
            assert!(after >= before, "{health:?} {worse:?}");
            before = after;
        }
    }
    assert!(seen.iter().all(|count| *count > 500), "all verdicts occur: {seen:?}");
}

/// Nobody flies on without a fresh pose, whatever else is well: hold within 0.6 s, then land.
#[test]
fn a_stale_pose_never_goes_on() {
    let limits = WatchdogLimits::default();
    let verdict = |ms: u64| {
        let pose_age = Some(Duration::from_millis(ms));
        judge(&Health { pose_age, ..Health::default() }, &limits)
    };
    for ms in 0..8_000 {
        let expected = match ms {
            0..500 => Verdict::Continue,
            500..1_500 => Verdict::Hold(Reason::PoseStale),
            _ => Verdict::Land(Reason::PoseStale),
        };
        assert_eq!(verdict(ms), expected, "{ms} ms");
    }
    let never = Health { pose_age: None, ..Health::default() };
    assert_eq!(judge(&never, &limits), Verdict::Land(Reason::PoseStale));
    let mut rng = Rng::new(10);
    for _ in 0..5_000 {
        let health = random_health(&mut rng);
        if health.pose_age.is_none_or(|age| age >= Duration::from_millis(600)) {
            assert_ne!(judge(&health, &limits), Verdict::Continue);
        }
    }
}

/// Each fault alone has its own action and reason.
#[test]
fn each_fault_has_its_action() {
    let well = Health::default();
    let ms = Duration::from_millis;
    use Reason::*;
    let cases = [
        (well, Verdict::Continue),
        (Health { relocating: true, ..well }, Verdict::Hold(Relocating)),
        (Health { link_age: Some(ms(999)), ..well }, Verdict::Continue),
        (Health { link_age: Some(ms(1_000)), ..well }, Verdict::Hold(LinkLost)),
        (Health { link_age: Some(ms(5_000)), ..well }, Verdict::Land(LinkLost)),
        (Health { link_age: None, ..well }, Verdict::Land(LinkLost)),
        (Health { lease_over: ms(1), ..well }, Verdict::Hold(LeaseOver)),
        (Health { lease_over: ms(30_000), ..well }, Verdict::Land(LeaseOver)),
        (Health { battery: Some(0.21), ..well }, Verdict::Continue),
        (Health { battery: Some(0.19), ..well }, Verdict::Land(BatteryLow)),
    ];
    for (health, verdict) in cases {
        assert_eq!(judge(&health, &WatchdogLimits::default()), verdict, "{health:?}");
    }
}

/// What is not a number is not well.
#[test]
fn a_number_that_is_none_is_not_well() {
    let well = Health::default();
    let health = Health { battery: Some(f64::NAN), ..well };
    assert_ne!(judge(&health, &WatchdogLimits::default()), Verdict::Continue);
}
