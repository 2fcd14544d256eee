//! Exclusive prefix sums and stable radix sort.
//!
//! The sort is stable: eight bits per pass on hardware, with digits ranked by the whole workgroup,
//! and four on a software driver, with ranks from each invocation's own counters. Gaussians are
//! sorted by depth and then by tile, so equal depths keep the order of the Gaussians and pictures
//! are reproducible to the last bit. Bits that all depths share are skipped, and tile keys have
//! only the required bits. One sort by a combined key would also move the pairs, several for each
//! Gaussian, by the bits of depth.

use crate::{
    codegen::{
        source::{Source, WORKGROUP_SIZE},
        uniform::{Count, uniform},
    },
    device::{
        context::Context,
        error::GpuError,
        kernel_set::KernelSet,
        kernels::{
            Binding::{Buffer, Uniform},
            Dispatch,
        },
        memory::Array,
    },
    stages::step_counters::{StepCounters, step_counters},
};

/// Numbers that a workgroup sums.
const SCAN_BLOCK: usize = 4096;
/// Consecutive elements that one invocation processes in turn.
pub(crate) const COLUMN: usize = 64;
/// Invocations of a workgroup that sorts: their counters take a quarter of its memory.
const SORT_GROUP: usize = 64;
/// Elements of each invocation of a workgroup that sorts in rows.
const ROWS: usize = 8;

/// Division of a sort into passes, and of a pass into workgroups.
#[derive(Clone, Copy, Debug)]
struct SortDivision {
    /// Bits of a key that one pass sorts by.
    digit_bits: u32,
    /// Consecutive elements whose digits are counted together.
    column: usize,
    /// Such columns of a workgroup.
    columns_of_group: usize,
}

impl SortDivision {
    const fn new(kernels: KernelSet) -> Self {
        match kernels {
            KernelSet::Software => Self { digit_bits: 4, column: COLUMN, columns_of_group: SORT_GROUP },
            KernelSet::Hardware => {
                Self { digit_bits: WORKGROUP_SIZE.ilog2(), column: ROWS * WORKGROUP_SIZE as usize, columns_of_group: 1 }
            }
        }
    }
}

uniform! {
    /// Pass of a sort, by some bits of the keys.
    struct SortPass {
        /// Elements, at most.
        count: u32,
        /// Parts of the elements whose digits are counted.
        columns: u32,
        shift: u32,
        mask: u32,
        /// 1 if the number of elements is read from the step counters.
        is_counted: u32,
    }
}

/// Appends the number of elements that one invocation processes in turn.
pub(crate) fn column(source: Source) -> Source {
    source.count("COLUMN", COLUMN)
}

pub(crate) fn scan_source() -> String {
    Source::new().count("SCAN_BLOCK", SCAN_BLOCK).uniform::<Count>().with(include_str!("scan.wgsl")).text()
}

pub(crate) fn iota_source() -> String {
    Source::new().uniform::<Count>().with(include_str!("iota.wgsl")).text()
}

pub(crate) fn sort_source(kernels: KernelSet) -> String {
    let source = Source::new().part(step_counters).uniform::<SortPass>().with(include_str!("sort_pass.wgsl"));
    let source = match kernels {
        KernelSet::Software => source
            .part(column)
            .count("SORT_GROUP", SORT_GROUP)
            .count("DIGIT_BITS", SortDivision::new(kernels).digit_bits as usize)
            .with(include_str!("narrow.wgsl")),
        KernelSet::Hardware => source.count("ROWS", ROWS).with(include_str!("wide.wgsl")),
    };
    source.text()
}

/// Replaces each of `len` numbers by the sum of the numbers before it.
///
/// # Errors
///
/// See [`Context::allocate`] and [`Context::dispatch`].
pub(crate) fn scan(context: &mut Context, numbers: &Array, len: usize) -> Result<(), GpuError> {
    let blocks = len.div_ceil(SCAN_BLOCK);
    let sums = context.allocate("sums", blocks)?;
    let size = Count::new(len);
    let bindings = [Uniform(size.bytes()), Buffer(numbers), Buffer(&sums)];
    context.dispatch("scan", "scan_blocks", &scan_source, &bindings, Dispatch::Workgroups(blocks))?;
    if blocks > 1 {
        scan(context, &sums, blocks)?;
        context.dispatch("scan", "add_block_sums", &scan_source, &bindings, Dispatch::Workgroups(blocks))?;
    }
    Ok(())
}

/// Array of the indices 0, 1, …, `len` − 1.
///
/// # Errors
///
/// See [`Context::allocate`] and [`Context::dispatch`].
pub(crate) fn iota(context: &mut Context, what: &'static str, len: usize) -> Result<Array, GpuError> {
    let numbers = context.allocate(what, len)?;
    let size = Count::new(len);
    let bindings = [Uniform(size.bytes()), Buffer(&numbers)];
    context.dispatch("iota", "iota", &iota_source, &bindings, Dispatch::Invocations(len))?;
    Ok(numbers)
}

/// Keys, each with an item.
#[derive(Debug)]
pub(crate) struct Pairs {
    pub(crate) keys: Array,
    pub(crate) items: Array,
}

/// Number of pairs.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Len {
    /// Known to the host.
    Known(usize),
    /// Stored in the step counters, and at most this.
    Counted(usize),
}

/// Sorts pairs by the lowest `bits` of their keys; pairs of equal keys keep their order.
///
/// # Errors
///
/// See [`Context::allocate`] and [`Context::dispatch`].
pub(crate) fn sort(
    context: &mut Context,
    counters: &StepCounters,
    mut pairs: Pairs,
    len: Len,
    bits: u32,
) -> Result<Pairs, GpuError> {
    let (len, is_counted) = match len {
        Len::Known(len) => (len, false),
        Len::Counted(most) => (most, true),
    };
    let kernels = context.kernels;
    let SortDivision { digit_bits, column, columns_of_group } = SortDivision::new(kernels);
    let columns = len.div_ceil(column);
    let groups = Dispatch::Workgroups(columns.div_ceil(columns_of_group));
    let starts = context.allocate("digits", columns << digit_bits)?;
    let (key, source) = (format!("sort {kernels:?}"), || sort_source(kernels));
    let mut other = Pairs { keys: context.allocate("keys", len)?, items: context.allocate("items", len)? };
    for shift in (0..bits).step_by(digit_bits as usize) {
        let mask = (1 << digit_bits.min(bits - shift)) - 1;
        let (count, is_counted) = (len as u32, u32::from(is_counted));
        let pass = SortPass { count, columns: columns as u32, shift, mask, is_counted };
        let bindings = [
            Uniform(pass.bytes()),
            Buffer(&pairs.keys),
            Buffer(&pairs.items),
            Buffer(&starts),
            Buffer(&other.keys),
            Buffer(&other.items),
            Buffer(counters.array()),
        ];
        context.dispatch(&key, "count_digits", &source, &bindings, groups)?;
        scan(context, &starts, columns << digit_bits)?;
        context.dispatch(&key, "move_elements", &source, &bindings, groups)?;
        (pairs, other) = (other, pairs);
    }
    Ok(pairs)
}

#[cfg(test)]
mod tests {
    use super::*;
    use specula_core::random;

    fn random_numbers(len: usize, bits: u32) -> Vec<u32> {
        (0..len).map(|k| (random::bits(7, u64::from(bits), k as u64) >> (64 - bits)) as u32).collect()
    }

    #[test]
    fn a_scan_returns_exclusive_prefix_sums() {
        let Some(mut context) = Context::for_tests() else { return };
        for len in [0, 1, 255, SCAN_BLOCK, SCAN_BLOCK + 1, 300_000, SCAN_BLOCK * SCAN_BLOCK + 1] {
            // Few bits, so the total fits into a word.
            let numbers = random_numbers(len, 7);
            let array = context.upload("numbers", &numbers).expect("numbers fit");
            scan(&mut context, &array, len).expect("the device adds");
            let mut sums = vec![0; len];
            context.download(&array, 0, &mut sums).expect("the length is that of the array");
            let mut before = 0;
            for (k, sum) in sums.into_iter().enumerate() {
                assert_eq!(sum, before, "number {k} of {len}");
                before += numbers[k];
            }
        }
    }

    #[test]
    fn workgroups_beyond_one_axis_of_a_dispatch_are_numbered_without_gaps() {
        let Some(mut context) = Context::for_tests() else { return };
        let len = 65_535 * WORKGROUP_SIZE as usize + 300;
        let array = iota(&mut context, "numbers", len).expect("numbers fit");
        let mut numbers = vec![0_u32; len];
        context.download(&array, 0, &mut numbers).expect("the length is that of the array");
        assert!(numbers.into_iter().eq(0..len as u32), "every invocation has its own number");
    }

    #[test]
    fn pairs_are_sorted_and_equal_keys_stay_in_their_order() {
        let Some(mut context) = Context::for_tests() else { return };
        for kernels in KernelSet::ALL {
            context.kernels = kernels;
            for bits in [1, 5, 12, 13, 24, 30, 32] {
                for len in [0, 1, COLUMN, COLUMN + 1, COLUMN * SORT_GROUP, 5000, 100_000] {
                    sorts_as_the_host(&mut context, &random_numbers(len, bits), bits);
                    sorts_as_the_host(&mut context, &vec![(1 << (bits - 1)) - 1; len], bits);
                }
            }
            // Bits above the sorted ones are moved along without effect.
            let keys: Vec<u32> = random_numbers(5000, 32);
            sorts_as_the_host(&mut context, &keys, 9);
        }
    }

    fn sorts_as_the_host(context: &mut Context, keys: &[u32], bits: u32) {
        let len = keys.len();
        let counters = StepCounters::new(context);
        let pairs = Pairs {
            keys: context.upload("keys", keys).expect("keys fit"),
            items: iota(context, "items", len).expect("items fit"),
        };
        let sorted = sort(context, &counters, pairs, Len::Known(len), bits).expect("the device sorts");
        let mut found = [vec![0; len], vec![0; len]];
        context.download(&sorted.keys, 0, &mut found[0]).expect("the length is that of the array");
        context.download(&sorted.items, 0, &mut found[1]).expect("the length is that of the array");
        let mut order: Vec<u32> = (0..len as u32).collect();
        let low = u32::MAX >> (32 - bits);
        order.sort_by_key(|item| keys[*item as usize] & low);
        assert!(found[1] == order, "{len} items by {bits} bits");
        assert!(
            found[0].iter().zip(&order).all(|(key, item)| *key == keys[*item as usize]),
            "keys go with their items"
        );
    }
}
