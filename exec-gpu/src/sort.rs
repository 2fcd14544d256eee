//! Exclusive sums, and stable sorting of pairs.

use crate::{
    device::GpuError,
    kernel::{
        Bound::{Array as Of, Uniform},
        Groups,
    },
    machine::Machine,
    memory::Array,
    source::{self, COLUMN, DIGIT_BITS, SCAN_BLOCK, SORT_GROUP},
};

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

/// How many there are.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Len {
    /// So many.
    Known(usize),
    /// As many as the ledger holds, which are no more than so many.
    Held(usize),
}

/// Sorts so many pairs by the lowest bits of their keys; equal keys stay in their order.
pub(crate) fn sort(machine: &mut Machine, mut pairs: Pairs, len: Len, bits: u32) -> Result<Pairs, GpuError> {
    let ledger = machine.ledger.clone();
    let (len, is_held) = match len {
        Len::Known(len) => (len, false),
        Len::Held(most) => (most, true),
    };
    let columns = len.div_ceil(COLUMN);
    let groups = Groups::Count(columns.div_ceil(SORT_GROUP));
    let starts = machine.take("digits", columns << DIGIT_BITS)?;
    let mut other = Pairs { keys: machine.take("keys", len)?, items: machine.take("items", len)? };
    for shift in (0..bits).step_by(DIGIT_BITS as usize) {
        let mask = (1 << DIGIT_BITS.min(bits - shift)) - 1;
        let settings = [len as u32, columns as u32, shift, mask, u32::from(is_held)];
        let bound = [
            Uniform(bytemuck::cast_slice(&settings)),
            Of(&pairs.keys),
            Of(&pairs.items),
            Of(&starts),
            Of(&other.keys),
            Of(&other.items),
            Of(ledger.array()),
        ];
        machine.run("sort", "count_digits", &source::sort, &bound, groups)?;
        scan(machine, &starts, columns << DIGIT_BITS)?;
        machine.run("sort", "move_elements", &source::sort, &bound, groups)?;
        (pairs, other) = (other, pairs);
    }
    Ok(pairs)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::GROUP;
    use specula_core::random;

    fn random_numbers(len: usize, bits: u32) -> Vec<u32> {
        (0..len).map(|k| (random::bits(7, u64::from(bits), k as u64) >> (64 - bits)) as u32).collect()
    }

    #[test]
    fn sums_are_those_of_all_numbers_before() {
        let Some(mut machine) = Machine::for_tests() else { return };
        for len in [0, 1, 255, SCAN_BLOCK, SCAN_BLOCK + 1, 300_000, SCAN_BLOCK * SCAN_BLOCK + 1] {
            // Few bits, so that the sum of all still fits into a word.
            let own = random_numbers(len, 7);
            let array = machine.upload("numbers", &own).expect("numbers fit");
            scan(&mut machine, &array, len).expect("the device adds");
            let mut sums = vec![0; len];
            machine.download(&array, 0, &mut sums).expect("there are so many");
            let mut before = 0;
            for (k, sum) in sums.into_iter().enumerate() {
                assert_eq!(sum, before, "number {k} of {len}");
                before += own[k];
            }
        }
    }

    #[test]
    fn more_groups_than_an_axis_of_a_dispatch_has_are_numbered_without_a_gap() {
        let Some(mut machine) = Machine::for_tests() else { return };
        let len = 65_535 * GROUP as usize + 300;
        let array = numbers(&mut machine, "numbers", len).expect("numbers fit");
        let mut own = vec![0_u32; len];
        machine.download(&array, 0, &mut own).expect("there are so many");
        assert!(own.into_iter().eq(0..len as u32), "every invocation has its own number");
    }

    #[test]
    fn pairs_are_sorted_and_equal_keys_stay_in_their_order() {
        let Some(mut machine) = Machine::for_tests() else { return };
        for bits in [1, 5, 12, 13, 24, 30, 32] {
            for len in [0, 1, COLUMN, COLUMN + 1, COLUMN * SORT_GROUP, 5000, 100_000] {
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
        let sorted = sort(machine, pairs, Len::Known(len), bits).expect("the device sorts");
        let mut own = [vec![0; len], vec![0; len]];
        machine.download(&sorted.keys, 0, &mut own[0]).expect("there are so many");
        machine.download(&sorted.items, 0, &mut own[1]).expect("there are so many");
        let mut order: Vec<u32> = (0..len as u32).collect();
        let low = u32::MAX >> (32 - bits);
        order.sort_by_key(|item| keys[*item as usize] & low);
        assert!(own[1] == order, "{len} items by {bits} bits");
        assert!(own[0].iter().zip(&order).all(|(key, item)| *key == keys[*item as usize]), "keys go with their items");
    }
}
