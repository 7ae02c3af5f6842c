use super::*;

/// The kernels of all instruction sets agree to the last bit, ties included.
#[test]
fn all_instruction_sets_agree() {
    let mut state = 5u32;
    let mut descriptors = |n: usize| {
        (0..n)
            .map(|_| {
                std::array::from_fn(|_| {
                    state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    // Few values, so that equal distances occur.
                    (state >> 30) as u8 * 42
                })
            })
            .collect::<Vec<_>>()
    };
    let mut second = descriptors(301);
    let first = descriptors(170);
    second.extend_from_slice(&first[20..60]);
    second.extend_from_slice(&first[30..50]);
    let (first, second) = (PackedDescriptors::new(&first), PackedDescriptors::new(&second));
    let plain = nearest_both_ways(SimdLevel::Portable, &first, &second);
    for &level in SimdLevel::available() {
        assert!(nearest_both_ways(level, &first, &second) == plain, "{level:?}");
    }
}
