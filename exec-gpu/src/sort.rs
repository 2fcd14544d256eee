//! Exclusive sums, and stable sorting of pairs.

use crate::{
    device::GpuError,
    kernel::{
        Bound::{Array as Of, Uniform},
        Groups,
    },
    machine::Machine,
    memory::Array,
    source::{self, SCAN_BLOCK, SORT_BLOCK},
};

/// Digits of a pass.
const DIGITS: usize = 16;
/// Bits of a digit.
const DIGIT_BITS: u32 = DIGITS.ilog2();

/// Replaces every number by the sum of those before it; `len` of them.
pub(crate) fn scan(machine: &mut Machine, numbers: &Array, len: usize) -> Result<(), GpuError> {
    let blocks = len.div_ceil(SCAN_BLOCK);
    let sums = machine.take("sums", blocks)?;
    let size = [len as u32];
    let bound = [Uniform(bytemuck::cast_slice(&size)), Of(numbers), Of(&sums)];
    machine.run("scan", "scan_blocks", &source::scan, &bound, Groups::Count(blocks))?;
    if blocks > 1 {
        scan(machine, &sums, blocks)?;
        machine.run("scan", "add_block_sums", &source::scan, &bound, Groups::Count(blocks))?;
    }
    Ok(())
}

/// The numbers from zero on.
pub(crate) fn numbers(machine: &mut Machine, what: &'static str, len: usize) -> Result<Array, GpuError> {
    let numbers = machine.take(what, len)?;
    let size = [len as u32];
    let bound = [Uniform(bytemuck::cast_slice(&size)), Of(&numbers)];
    machine.run("numbers", "count_up", &source::numbers, &bound, Groups::For(len))?;
    Ok(numbers)
}

/// Keys and what belongs to them.
#[derive(Debug)]
pub(crate) struct Pairs {
    pub(crate) keys: Array,
    pub(crate) items: Array,
}

/// Sorts so many pairs by the lowest bits of their keys; equal keys stay in their order.
pub(crate) fn sort(machine: &mut Machine, mut pairs: Pairs, len: usize, bits: u32) -> Result<Pairs, GpuError> {
    let blocks = len.div_ceil(SORT_BLOCK);
    let starts = machine.take("digits", DIGITS * blocks)?;
    let mut other = Pairs { keys: machine.take("keys", len)?, items: machine.take("items", len)? };
    for pass in 0..bits.div_ceil(DIGIT_BITS) {
        let settings = [len as u32, pass * DIGIT_BITS, blocks as u32];
        let bound = [
            Uniform(bytemuck::cast_slice(&settings)),
            Of(&pairs.keys),
            Of(&pairs.items),
            Of(&starts),
            Of(&other.keys),
            Of(&other.items),
        ];
        machine.run("sort", "count_digits", &source::sort, &bound, Groups::Count(blocks))?;
        scan(machine, &starts, DIGITS * blocks)?;
        machine.run("sort", "move_elements", &source::sort, &bound, Groups::Count(blocks))?;
        (pairs, other) = (other, pairs);
    }
    Ok(pairs)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::Gpu;
    use specula_core::random;

    fn machine() -> Option<Machine> {
        match Gpu::new("") {
            Ok(gpu) => Some(Machine::new(gpu)),
            Err(error) if std::env::var_os("CI").is_some() => panic!("CI needs an adapter: {error}"),
            Err(error) => {
                eprintln!("NOT TESTED, because {error}");
                None
            }
        }
    }

    fn random_numbers(len: usize, bits: u32) -> Vec<u32> {
        (0..len).map(|k| (random::bits(7, u64::from(bits), k as u64) >> (64 - bits)) as u32).collect()
    }

    #[test]
    fn sums_are_those_of_all_numbers_before() {
        let Some(mut machine) = machine() else { return };
        for len in [0, 1, 255, 1024, 1025, 300_000, 1_100_000] {
            let own = random_numbers(len, 10);
            let array = machine.upload("numbers", &own).expect("numbers fit");
            scan(&mut machine, &array, len).expect("the device adds");
            let mut sums = vec![0; len];
            machine.download_counts(&array, &mut sums).expect("there are so many");
            let mut before = 0;
            for (k, sum) in sums.into_iter().enumerate() {
                assert_eq!(sum, before, "number {k} of {len}");
                before += own[k];
            }
        }
    }

    #[test]
    fn pairs_are_sorted_and_equal_keys_stay_in_their_order() {
        let Some(mut machine) = machine() else { return };
        for bits in [1, 5, 12, 13, 24, 30, 32] {
            for len in [0, 1, 17, 2047, 2048, 5000, 100_000] {
                sorts_as_the_host(&mut machine, &random_numbers(len, bits), bits);
                sorts_as_the_host(&mut machine, &vec![(1 << (bits - 1)) - 1; len], bits);
            }
        }
        // Bits above those that are sorted by change nothing but go along.
        let keys: Vec<u32> = random_numbers(5000, 32);
        sorts_as_the_host(&mut machine, &keys, 9);
    }

    fn sorts_as_the_host(machine: &mut Machine, keys: &[u32], bits: u32) {
        let len = keys.len();
        let pairs = Pairs {
            keys: machine.upload("keys", keys).expect("keys fit"),
            items: numbers(machine, "items", len).expect("items fit"),
        };
        let sorted = sort(machine, pairs, len, bits).expect("the device sorts");
        let mut own = [vec![0; len], vec![0; len]];
        machine.download_counts(&sorted.keys, &mut own[0]).expect("there are so many");
        machine.download_counts(&sorted.items, &mut own[1]).expect("there are so many");
        let mut order: Vec<u32> = (0..len as u32).collect();
        let low = u32::MAX >> (32 - bits);
        order.sort_by_key(|item| keys[*item as usize] & low);
        assert!(own[1] == order, "{len} items by {bits} bits");
        assert!(own[0].iter().zip(&order).all(|(key, item)| *key == keys[*item as usize]), "keys go with their items");
    }

    #[test]
    #[ignore = "a measurement"]
    fn bench() {
        let Some(mut machine) = machine() else { return };
        for (len, bits) in [(400_000, 12), (100_000, 32), (100_000, 24), (5000, 12)] {
            let keys = random_numbers(len, bits);
            let keys = machine.upload("keys", &keys).expect("keys fit");
            let items = numbers(&mut machine, "items", len).expect("items fit");
            let mut times = Vec::new();
            for _ in 0..12 {
                let keys = machine.copy("keys", &keys).unwrap();
                let items = machine.copy("keys", &items).unwrap();
                machine.download_counts(&items, &mut [0]).unwrap();
                let start = std::time::Instant::now();
                let sorted = sort(&mut machine, Pairs { keys, items }, len, bits).unwrap();
                machine.download_counts(&sorted.items, &mut [0]).unwrap();
                times.push(start.elapsed().as_secs_f64() * 1e3);
            }
            times.sort_by(f64::total_cmp);
            println!("sort {len} by {bits}: {:.2} ms, median {:.2}", times[0], times[6]);
        }
        let array = machine.zeros("numbers", 400_000).unwrap();
        let mut times = Vec::new();
        for _ in 0..12 {
            machine.download_counts(&array, &mut [0]).unwrap();
            let start = std::time::Instant::now();
            scan(&mut machine, &array, 400_000).unwrap();
            machine.download_counts(&array, &mut [0]).unwrap();
            times.push(start.elapsed().as_secs_f64() * 1e3);
        }
        times.sort_by(f64::total_cmp);
        println!("scan 400000: {:.2} ms, median {:.2}", times[0], times[6]);
    }
}
