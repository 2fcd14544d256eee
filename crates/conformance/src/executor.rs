//! Requirements of training.

use crate::{
    compare::{ROUNDING_F32, SAME_GRADIENT, SAME_PHYSICAL_GRADIENT, relative_difference},
    near_fields::{polished, random_near_field},
    report::{Report, Subject, require, requirements, said},
    stress::{every_case, results::Results},
    view::{RESOLUTION, operator},
};
use half::f16;
use specula_core::{
    camera::Camera,
    color::Picture,
    double::Double,
    executor::{Executor, Feature, TrainingStep, Unsupported},
    loss::{LossWeights, NormalForm},
    near_field::NearField,
    optimise::{Moment, adam, corrected_epsilon, corrected_rate, is_usable},
    pipeline::{train_step, view_gradient},
    prefilter::PrefilterScheme,
    random,
    rules::{Channels, RenderRules},
    scene::{
        DIFFUSE, Environment, Gaussians, LOG_SCALE, Layout, MEAN, NORMAL_RESIDUAL_1, NORMAL_RESIDUAL_2, OPACITY, QUAT,
        ROUGHNESS, RadianceActivation, TINT,
    },
    shade::ShadingRules,
    state::{AdamMoments, SceneState, Statistics},
};
use specula_oracle::{
    self as oracle, lift_environment, lift_gaussians,
    scenes::{camera, random_cloud, random_environment},
};

requirements! {
    $ executor_requirements: Executor;
    executor::{
        gradients_of_losses_are_those_of_the_reference,
        gradients_through_pixels_and_lights_are_those_of_the_reference_or_refused,
        an_update_is_its_gradient_and_a_step_to_the_last_bit,
        steps_of_adam_leave_out_gradients_that_are_not_finite,
        extreme_scenes_have_finite_gradients,
        sums_are_exact_or_refused_by_name,
        steps_are_the_same_bits_every_time,
    };
    /// Writes one `#[test]` for each requirement of an `Executor` beyond those of a `Renderer`. The
    /// argument makes the executor, or `None` where it cannot run.
    executor_tests
}

/// Checks the requirements of training.
pub fn check_executor<E: Executor>(subject: &Subject<'_, E>) -> Report {
    Report::of(subject, &executor_requirements())
}

const BACKGROUND: [f32; 3] = [0.1, 0.2, 0.3];
const SIZE: [usize; 2] = [40, 33];

fn wide(values: &[f32]) -> Vec<f64> {
    values.iter().map(|x| f64::from(*x)).collect()
}

/// Planes of each attribute.
pub(crate) fn groups(layout: Layout) -> Vec<(&'static str, core::ops::Range<usize>)> {
    let shape = [
        ("means", MEAN..LOG_SCALE),
        ("scales", LOG_SCALE..QUAT),
        ("quats", QUAT..OPACITY),
        ("opacity", OPACITY..DIFFUSE),
    ];
    let surface = [
        ("diffuse", DIFFUSE..TINT),
        ("tint", TINT..ROUGHNESS),
        ("roughness", ROUGHNESS..NORMAL_RESIDUAL_1),
        ("first normal residual", NORMAL_RESIDUAL_1..NORMAL_RESIDUAL_2),
        ("second normal residual", NORMAL_RESIDUAL_2..layout.sh_start()),
    ];
    let harmonics = ("harmonics", layout.sh_start()..layout.sh_end());
    let surface = surface.into_iter().filter(|_| layout.is_shaded());
    shape.into_iter().chain(surface).chain([harmonics]).filter(|(_, planes)| !planes.is_empty()).collect()
}

/// Scene with its ground truth, and the weights of its losses.
struct Training {
    gaussians: Gaussians<Vec<f32>>,
    environment: Option<Environment<Vec<f32>>>,
    near_field: Option<NearField<Vec<f32>>>,
    rules: RenderRules,
    weights: LossWeights,
    rgba: Vec<u8>,
    unclipped: Option<Vec<[f16; 3]>>,
}

impl Training {
    fn new(shading: ShadingRules, layout: Layout, near_field: bool, seed: u64) -> Self {
        let [width, height] = SIZE;
        let gaussians = random_cloud(40, layout, seed);
        // Every other scene is overexposed.
        let saturates = seed.is_multiple_of(2);
        let mut environment = random_environment(RESOLUTION, RadianceActivation::Exponential, seed);
        let mut rgba: Vec<u8> = (0..width * height * 4).map(|k| (k * 37 % 251) as u8).collect();
        if saturates {
            rgba.chunks_exact_mut(8).for_each(|two| two[..4].fill(255));
            environment.values.iter_mut().for_each(|number| *number += 1.5);
        }
        // Every third one is not clipped, and brighter than white.
        let color = |k: usize| [k * 37 % 251, k * 53 % 241, k * 71 % 239].map(|x| f16::from_f32(x as f32 / 100.0));
        let unclipped = seed.is_multiple_of(3).then(|| (0..width * height).map(color).collect());
        let weights = LossWeights {
            absolute: 0.5,
            squared: 0.3,
            dssim: 0.2,
            normal: if layout.is_shaded() { 0.1 } else { 0.0 },
            normal_form: NormalForm::Cosine,
            smoothness: if layout.is_shaded() { 0.2 } else { 0.0 },
            coverage: 0.1,
            sparse: 1e-3,
            residual: if layout.is_shaded() { 1e-2 } else { 0.0 },
            saturates,
            ..LossWeights::NONE
        };
        Self {
            gaussians: if near_field { polished(gaussians) } else { gaussians },
            environment: layout.is_shaded().then_some(environment),
            near_field: near_field.then(|| random_near_field(60, seed)),
            rules: RenderRules {
                traces_near: near_field,
                ..RenderRules::full(shading, PrefilterScheme::Exact, Channels::Training)
            },
            weights,
            rgba,
            unclipped,
        }
    }

    fn camera() -> Camera {
        camera(SIZE[0] as u32, SIZE[1] as u32)
    }

    fn picture(&self) -> Picture<'_> {
        let [width, height] = SIZE;
        Picture { width, height, rgba: &self.rgba, unclipped: self.unclipped.as_deref() }
    }

    fn is_deferred(&self) -> bool {
        self.rules.is_deferred(self.gaussians.layout)
    }

    /// Calls `step` with the inputs of a step on an executor.
    fn with_step<E: Executor, T>(
        &self,
        exec: &mut E,
        rates: &[f32],
        step: impl FnOnce(&mut E, &TrainingStep<'_, E>) -> Result<T, E::Error>,
    ) -> Result<T, String> {
        let target = exec.target(&self.picture()).map_err(said)?;
        let near_field = self.near_field.as_ref();
        let near_field = near_field.map(|near_field| near_field.with_values(near_field.values.as_slice()));
        let near_field = near_field.map(|near_field| exec.upload_near_field(&near_field)).transpose().map_err(said)?;
        let inputs = TrainingStep {
            camera: &Self::camera(),
            target: &target,
            background: BACKGROUND,
            exposure: None,
            near_field: near_field.as_ref(),
            rules: &self.rules,
            weights: &self.weights,
            is_observed: true,
            rates,
            environment_rate: 0.0,
            radiance_max: f32::MAX,
            number: 3,
            light_number: 3,
            own_loss: None,
        };
        step(exec, &inputs).map_err(said)
    }

    fn uploaded_environment<E: Executor>(&self, exec: &mut E) -> Result<Option<Environment<E::Array>>, String> {
        let Some(environment) = &self.environment else { return Ok(None) };
        Ok(Some(environment.with_values(exec.upload(&environment.values).map_err(said)?)))
    }

    /// Gradients of the Gaussians and of the light on an executor.
    fn gradients<E: Executor>(&self, exec: &mut E) -> Result<(Gaussians<Vec<f32>>, Option<Vec<f32>>), String> {
        let gaussians = exec.upload_gaussians(&self.gaussians).map_err(said)?;
        let environment = self.uploaded_environment(exec)?;
        let (gradient, _) =
            self.with_step(exec, &[], |exec, step| view_gradient(exec, &gaussians, environment.as_ref(), None, step))?;
        let mut values = vec![f32::NAN; self.gaussians.values.len()];
        exec.download(&gradient.gaussians.values, &mut values).map_err(said)?;
        let light = gradient.light.map(|light| {
            let mut values = vec![f32::NAN; self.environment.as_ref().map_or(0, |light| light.values.len())];
            exec.download(&light, &mut values).map_err(said).map(|()| values)
        });
        Ok((self.gaussians.with_values(values), light.transpose()?))
    }

    /// Gradients in `f64`.
    fn exact(&self) -> oracle::Gradient<Double> {
        let over = |c: usize| {
            self.rgba.chunks_exact(4).enumerate().map(move |(k, pixel)| {
                let alpha = f64::from(pixel[3]) / 255.0;
                let color = self.unclipped.as_ref().map_or(f64::from(pixel[c]) / 255.0, |colors| colors[k][c].into());
                Double(color * alpha + (1.0 - alpha) * f64::from(BACKGROUND[c]))
            })
        };
        let target = oracle::Target {
            srgb: over(0).chain(over(1)).chain(over(2)).collect(),
            alpha: Some(self.rgba.chunks_exact(4).map(|pixel| Double(f64::from(pixel[3]) / 255.0)).collect()),
            background: BACKGROUND,
            is_clipped: self.unclipped.is_none(),
        };
        let view = oracle::View {
            camera: &Self::camera(),
            target: &target,
            rules: &self.rules,
            weights: &self.weights,
            near_field: self.near_field.as_ref(),
        };
        let operator = operator(RESOLUTION);
        let environment = self.environment.as_ref().map(lift_environment);
        let environment = environment.as_ref().map(|environment| (environment, &*operator));
        oracle::loss_and_gradient(&lift_gaussians(&self.gaussians), environment, &view).1
    }

    /// Compares the gradients of an executor with those of the reference, attribute by attribute.
    fn compare<E: Executor>(&self, exec: &mut E) -> Result<(), String> {
        let (grad, light_grad) = self.gradients(exec)?;
        let exact = self.exact();
        let layout = self.gaussians.layout;
        let is_physical = self.rules.shading == ShadingRules::PHYSICAL;
        let tolerance = if is_physical { SAME_PHYSICAL_GRADIENT } else { SAME_GRADIENT };
        let what = format!("{:?} form, {layout:?}", self.rules.shading.form);
        let has_filter_grad = layout.filter_plane().is_some_and(|plane| grad.plane(plane).any(|grad| grad != 0.0));
        require(!has_filter_grad, || format!("{what}: filters have a gradient"))?;
        for (name, planes) in groups(layout) {
            let places = planes.flat_map(|plane| (0..grad.count).map(move |k| (k, plane)));
            let (ours, theirs): (Vec<f64>, Vec<f64>) = places
                .map(|(k, plane)| grad.index_of(k, plane))
                .map(|index| (f64::from(grad.values[index]), exact.gaussians.values[index].0))
                .unzip();
            let difference = relative_difference(&ours, &theirs);
            println!("{what}, {name}: {difference:.1e}");
            require(difference < tolerance, || format!("{what}: gradients of {name} differ by {difference:e}"))?;
        }
        let Some(exact) = exact.environment else {
            return require(light_grad.is_none(), || format!("{what}: there is no light, and a gradient of one"));
        };
        let light_grad = light_grad.ok_or_else(|| format!("{what}: the light has no gradient"))?;
        let theirs: Vec<f64> = exact.iter().map(|x| x.0).collect();
        let difference = relative_difference(&wide(&light_grad), &theirs);
        println!("{what}, light: {difference:.1e}");
        require(difference < tolerance, || format!("{what}: gradients of the light differ by {difference:e}"))
    }
}

/// Compares gradients of all losses of Gaussians without a shading function.
///
/// # Errors
///
/// The fault.
pub fn gradients_of_losses_are_those_of_the_reference<E: Executor>(subject: &Subject<'_, E>) -> Result<(), String> {
    for (seed, layout) in (5..).zip([Layout::radiance(3), Layout::radiance(0).antialiased()]) {
        Training::new(ShadingRules::PAPER, layout, false, seed).compare(&mut subject.executor())?;
    }
    Ok(())
}

/// Compares gradients of all losses of lit surfaces: light of Gaussians and of pixels, near fields,
/// physical materials.
///
/// # Errors
///
/// The fault.
pub fn gradients_through_pixels_and_lights_are_those_of_the_reference_or_refused<E: Executor>(
    subject: &Subject<'_, E>,
) -> Result<(), String> {
    let layout = Layout::shaded(Some(3));
    for seed in 5..7 {
        for (shading, layout, near_field) in [
            (ShadingRules::PAPER, layout, false),
            (ShadingRules::DEFERRED, layout, false),
            (ShadingRules::DEFERRED, layout.antialiased(), false),
            (ShadingRules::DEFERRED, layout, true),
            (ShadingRules::PHYSICAL, layout.physical(), false),
            (ShadingRules::PHYSICAL, layout.physical(), true),
        ] {
            let training = Training::new(shading, layout, near_field, seed);
            let mut exec = subject.executor();
            let needs = [
                (true, Feature::LightGradients),
                (training.is_deferred(), Feature::PixelGradients),
                (near_field, Feature::NearFields),
            ];
            let mut missing = needs.into_iter().filter(|(is_needed, feature)| *is_needed && !exec.has(*feature));
            if missing.next().is_none() {
                training.compare(&mut exec)?;
                continue;
            }
            let Err(error) = training.gradients(&mut exec) else {
                return Err("gradients that the executor does not have are not refused".to_owned());
            };
            let named = needs.iter().any(|(_, feature)| error.contains(feature.name()));
            require(named, || format!("refused as {error}, not by the name of a feature"))?;
        }
    }
    Ok(())
}

/// Parameters after a step, with their moments.
fn after_step<E: Executor>(
    exec: &mut E,
    training: &Training,
    in_two: bool,
) -> Result<(Vec<f32>, Vec<f32>, Vec<f32>), String> {
    let cloud = &training.gaussians;
    let zeros = cloud.with_values(vec![0.0; cloud.values.len()]);
    let gaussians = exec.upload_gaussians(cloud).map_err(said)?;
    let [mean, square] = [exec.upload_gaussians(&zeros), exec.upload_gaussians(&zeros)];
    let mut moments = AdamMoments { mean: mean.map_err(said)?.values, square: square.map_err(said)?.values };
    let mut counts = || exec.upload(&vec![0.0; cloud.count]).map_err(said);
    let statistics = Statistics { grad_sum: counts()?, view_count: counts()? };
    let environment = training.uploaded_environment(exec)?;
    let rates: Vec<f32> = (0..cloud.layout.plane_count()).map(|plane| 1e-3 * plane as f32).collect();
    let (gaussians, moments) = training.with_step(exec, &rates, |exec, step| {
        if in_two {
            let (gradient, _) = view_gradient(exec, &gaussians, environment.as_ref(), None, step)?;
            let mut gaussians = gaussians;
            exec.optimise(&mut gaussians, &mut moments, gradient.gaussians, step.rates, step.number)?;
            return Ok((gaussians, moments));
        }
        let mut state = SceneState { gaussians, moments, statistics, light: None };
        if let Some(environment) = environment {
            let zeros = vec![0.0; training.environment.as_ref().map_or(0, |light| light.values.len())];
            let moments = AdamMoments { mean: exec.upload(&zeros)?, square: exec.upload(&zeros)? };
            state.light = Some((environment, moments));
        }
        train_step(exec, &mut state, step)?;
        Ok((state.gaussians, state.moments))
    })?;
    let mut download = |array: &E::Array| {
        let mut values = vec![f32::NAN; cloud.values.len()];
        exec.download(array, &mut values).map_err(said).map(|()| values)
    };
    Ok((download(&gaussians.values)?, download(&moments.mean)?, download(&moments.square)?))
}

/// Trainings that an executor has the features for.
fn trainings<E: Executor>(exec: &E) -> Vec<Training> {
    let mut trainings = vec![Training::new(ShadingRules::PAPER, Layout::radiance(2), false, 7)];
    if exec.has(Feature::LightGradients) {
        trainings.push(Training::new(ShadingRules::PAPER, Layout::shaded(Some(3)), false, 7));
        if exec.has(Feature::PixelGradients) {
            trainings.push(Training::new(ShadingRules::DEFERRED, Layout::shaded(Some(3)), false, 7));
        }
    }
    trainings
}

/// Updates Gaussians at once as by a gradient and a step of Adam.
///
/// # Errors
///
/// The fault.
pub fn an_update_is_its_gradient_and_a_step_to_the_last_bit<E: Executor>(
    subject: &Subject<'_, E>,
) -> Result<(), String> {
    for training in trainings(&subject.executor()) {
        let [at_once, in_two] = [false, true].map(|in_two| after_step(&mut subject.executor(), &training, in_two));
        let (at_once, in_two) = (at_once?, in_two?);
        let what = training.rules.shading.form;
        require(at_once == in_two, || format!("{what:?}: an update is another than its two stages"))?;
        require(at_once.0 != training.gaussians.values, || format!("{what:?}: nothing moved"))?;
    }
    Ok(())
}

/// Trains the same bits on two executors.
///
/// # Errors
///
/// The fault.
pub fn steps_are_the_same_bits_every_time<E: Executor>(subject: &Subject<'_, E>) -> Result<(), String> {
    for training in trainings(&subject.executor()) {
        let mut exec = subject.executor();
        let first = after_step(&mut exec, &training, false)?;
        require(after_step(&mut exec, &training, false)? == first, || "a second step is another".to_owned())?;
        let another = after_step(&mut subject.executor(), &training, false)?;
        require(another == first, || "another executor takes another step".to_owned())?;
    }
    Ok(())
}

/// Takes steps of Adam, and leaves numbers alone whose gradients are not finite.
///
/// # Errors
///
/// The fault.
pub fn steps_of_adam_leave_out_gradients_that_are_not_finite<E: Executor>(
    subject: &Subject<'_, E>,
) -> Result<(), String> {
    let layout = Layout::shaded(Some(1));
    let cloud = random_cloud(80, layout, 5);
    let len = cloud.values.len();
    let draw = |stream: u64, low: f32, high: f32| -> Vec<f32> {
        (0..len).map(|k| low + (high - low) * random::uniform(5, stream, k as u64)).collect()
    };
    let (mean, square, mut grad) = (draw(1, -0.1, 0.1), draw(2, 0.0, 0.1), draw(3, -1.0, 1.0));
    for (k, wrong) in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -f32::NAN].into_iter().enumerate() {
        grad.iter_mut().skip(7 * k + 3).step_by(113).for_each(|x| *x = wrong);
    }
    let rates: Vec<f32> = (0..layout.plane_count()).map(|plane| 0.001 * (1 + plane) as f32).collect();
    let step = 2;
    let mut exec = subject.executor();
    let mut upload = |values: &[f32]| exec.upload_gaussians(&cloud.with_values(values)).map_err(said);
    let mut gaussians = upload(&cloud.values)?;
    let mut moments = AdamMoments { mean: upload(&mean)?.values, square: upload(&square)?.values };
    let uploaded = upload(&grad)?;
    exec.optimise(&mut gaussians, &mut moments, uploaded, &rates, step).map_err(said)?;
    let report = exec.report().map_err(said)?.ok_or("a step without a picture needs no repetition")?;
    let wrong = grad.iter().filter(|x| !x.is_finite()).count();
    require(report.nonfinite == wrong, || format!("{} of {wrong} gradients were counted", report.nonfinite))?;

    let lists = [(&gaussians.values, "values"), (&moments.mean, "means"), (&moments.square, "squares")];
    for (k, (array, what)) in lists.into_iter().enumerate() {
        let mut found = vec![f32::NAN; len];
        exec.download(array, &mut found).map_err(said)?;
        let before = [&cloud.values, &mean, &square][k];
        let expected: Vec<f64> = (0..len)
            .map(|index| {
                let plane = index / specula_core::scene::BLOCK % layout.plane_count();
                let of = |values: &[f32]| Double::from(values[index]);
                let moment = Moment { value: of(&cloud.values), mean: of(&mean), square: of(&square) };
                let rate = Double::from(corrected_rate(rates[plane], step));
                let Moment { value, mean, square } =
                    adam(moment, of(&grad), rate, Double::from(corrected_epsilon(step)));
                if is_usable(grad[index]) { [value, mean, square][k].0 } else { f64::from(before[index]) }
            })
            .collect();
        let difference = relative_difference(&wide(&found), &expected);
        require(difference <= ROUNDING_F32, || format!("{what} after a step of Adam differ by {difference:e}"))?;
        let kept = (0..len).filter(|index| !is_usable(grad[*index])).all(|index| found[index] == before[index]);
        require(kept, || format!("{what} moved without a finite gradient"))?;
    }
    Ok(())
}

/// Trains scenes at the limits of valid input.
///
/// # Errors
///
/// All faults.
pub fn extreme_scenes_have_finite_gradients<E: Executor>(subject: &Subject<'_, E>) -> Result<(), String> {
    let mut exec = subject.executor();
    let mut faults = Vec::new();
    let (has_light, has_pixels) = (exec.has(Feature::LightGradients), exec.has(Feature::PixelGradients));
    for case in every_case() {
        let plain = case.shadings().iter().map(|shading| (case.clone(), *shading));
        let materials = (case.with_materials(), ShadingRules::PHYSICAL);
        for (case, shading) in plain.chain([materials]) {
            let is_deferred = shading != ShadingRules::PAPER;
            if (case.environment.is_some() && !has_light) || (is_deferred && !has_pixels) {
                continue;
            }
            let Results { picture, gradient, losses, nonfinite } = Results::new(&mut exec, &case, shading);
            let what = format!("{} ({:?})", case.name, shading.form);
            if ![picture, gradient, losses].iter().flatten().all(|x| x.is_finite()) {
                faults.push(format!("{what}: a number is not finite"));
            }
            if nonfinite != 0 {
                faults.push(format!("{what}: {nonfinite} gradients are not finite"));
            }
        }
    }
    require(faults.is_empty(), || faults.join("\n"))
}

/// Adds arrays to the last bit.
///
/// # Errors
///
/// The fault.
pub fn sums_are_exact_or_refused_by_name<E: Executor>(subject: &Subject<'_, E>) -> Result<(), String> {
    let mut exec = subject.executor();
    let draw = |stream: u64| (0..257).map(|k| random::uniform(stream, 7, k) - 0.5).collect::<Vec<f32>>();
    let (first, second) = (draw(1), draw(2));
    let (mut sum, term) = (exec.upload(&first).map_err(said)?, exec.upload(&second).map_err(said)?);
    match exec.add(&mut sum, &term) {
        Err(error) => {
            let expected = Unsupported::feature(Feature::Sums);
            let is_named = !exec.has(Feature::Sums) && error.to_string().contains(Feature::Sums.name());
            require(is_named, || format!("sums failed as {error}, not as {expected}"))
        }
        Ok(()) => {
            let mut found = vec![f32::NAN; first.len()];
            exec.download(&sum, &mut found).map_err(said)?;
            let is_exact = found.iter().zip(first.iter().zip(&second)).all(|(sum, (a, b))| *sum == a + b);
            require(is_exact, || "sums differ in their last bits".to_owned())
        }
    }
}
