//! Sampling intervals of views, and 3D filters.

use crate::{
    codegen::formula::formula,
    stages::camera::{camera_fields, take_camera},
};
use specula_core::antialias::{SamplingInterval, sampling_interval};

/// Sampling interval of one view at a point ([`specula_core::antialias::sampling_interval`]).
#[derive(Clone, Copy, Debug)]
pub struct IntervalOf;

formula!(IntervalOf, |_, inputs| interval_of(point: 3, ..camera_fields()) -> (seen: 1, turned: 1) {
    let SamplingInterval { seen, turned } = sampling_interval(inputs.vec3(), &take_camera(inputs));
    [seen, turned]
});

/// The smaller intervals of two sets of views ([`SamplingInterval::min`]).
#[derive(Clone, Copy, Debug)]
pub struct LeastInterval;

formula!(LeastInterval, |_, inputs| least_interval(least: 2, other: 2) -> (seen: 1, turned: 1) {
    let mut interval = || {
        let [seen, turned] = inputs.array();
        SamplingInterval { seen, turned }
    };
    let (least, other) = (interval(), interval());
    let SamplingInterval { seen, turned } = least.min(other);
    [seen, turned]
});

/// Deviation of the filter in space ([`SamplingInterval::filter`]).
#[derive(Clone, Copy, Debug)]
pub struct DeviationOf;

formula!(DeviationOf, |_, inputs| deviation_of(interval: 2) -> (deviation: 1) {
    let [seen, turned] = inputs.array();
    [SamplingInterval { seen, turned }.filter()]
});
