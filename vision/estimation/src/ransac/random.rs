//! Reproducible random samples.

/// xoshiro256++ (Blackman & Vigna 2019), seeded by SplitMix64. Not for secrets.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Random {
    state: [u64; 4],
}

impl Random {
    /// The sequence of `seed`.
    pub fn new(seed: u64) -> Self {
        let mut z = seed;
        let state = std::array::from_fn(|_| {
            z = z.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let mut x = z;
            x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            x ^ (x >> 31)
        });
        Self { state }
    }

    /// 64 random bits.
    pub fn next_u64(&mut self) -> u64 {
        let s = &mut self.state;
        let result = s[0].wrapping_add(s[3]).rotate_left(23).wrapping_add(s[0]);
        let t = s[1] << 17;
        s[2] ^= s[0];
        s[3] ^= s[1];
        s[1] ^= s[2];
        s[0] ^= s[3];
        s[2] ^= t;
        s[3] = s[3].rotate_left(45);
        result
    }

    /// Uniform in `0..n`; `n` must not be zero. The bias is below n / 2⁶⁴.
    pub fn below(&mut self, n: usize) -> usize {
        ((u128::from(self.next_u64()) * n as u128) >> 64) as usize
    }

    /// Uniform in [0, 1).
    pub fn unit(&mut self) -> f64 {
        (self.next_u64() >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
    }

    /// Fills `sample` with distinct indices below `n`, which must be at least its length.
    pub fn distinct(&mut self, n: usize, sample: &mut [usize]) {
        for filled in 0..sample.len() {
            loop {
                let index = self.below(n);
                if !sample[..filled].contains(&index) {
                    sample[filled] = index;
                    break;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_are_distinct_uniform_and_repeatable() {
        let mut random = Random::new(7);
        let mut counts = [0usize; 8];
        for _ in 0..8000 {
            let mut sample = [0; 3];
            random.distinct(8, &mut sample);
            assert!(sample[0] != sample[1] && sample[1] != sample[2] && sample[0] != sample[2]);
            sample.iter().for_each(|&i| counts[i] += 1);
        }
        // 3000 expected, binomial sd 43.
        assert!(counts.iter().all(|&c| (2780..3220).contains(&c)), "{counts:?}");
        assert_eq!(Random::new(3).next_u64(), Random::new(3).next_u64());
        assert_ne!(Random::new(3).next_u64(), Random::new(4).next_u64());
    }
}
