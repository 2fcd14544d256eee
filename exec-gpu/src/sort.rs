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
