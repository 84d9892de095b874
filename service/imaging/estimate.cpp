#include "service/imaging/estimate.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <numbers>
#include <random>
#include <string>
#include <utility>

#include "service/base/choices.h"
#include "service/device/cancellation.h"
#include "service/imaging/modulus/stated_depth.h"
#include "service/imaging/tracking/input_checks.h"

namespace teletact::service {
namespace {

// Before a pair is called decorrelated it is searched once more over so many times the strain, up to the
// largest that can be asked for.
constexpr double kWiderSearch = 2;

class StageClock {
 public:
  double lap() {
    const double now_s = worked_s();
    return now_s - std::exchange(start_s_, now_s);
  }

 private:
  double start_s_ = worked_s();
};

// Any textured frame; `stretch` moves its samples apart, so that the pair shows strain.
RfFrame texture(std::size_t samples, std::size_t lines, double stretch) {
  RfFrame frame{samples, lines, std::vector<float>(samples * lines)};
  for (std::size_t l = 0; l < lines; ++l) {
    std::mt19937 generator(static_cast<unsigned>(l / 2));
    std::uniform_real_distribution<double> phase(0, 2 * std::numbers::pi);
    const double phases[] = {phase(generator), phase(generator), phase(generator)};
    for (std::size_t k = 0; k < samples; ++k) {
      const double at = (1 + stretch) * static_cast<double>(k);
      frame.samples[k + samples * l] = static_cast<float>(
          std::sin(1.0 * at + phases[0]) + std::sin(1.17 * at + phases[1]) + std::sin(0.86 * at + phases[2]));
    }
  }
  return frame;
}

struct HostBytes {
  std::uint64_t maps, working;
};

// Maps on the image grid, and meanwhile what they are read from the device as and the blocks of the direct
// modulus (T3.2), which the iterative one starts from: four of ny^2 for each column of nodes, 1 mm apart.
HostBytes host_bytes(const RfFrame& frame, const EstimateInput& in) {
  constexpr double kMaps = 14, kRead = 20, kFineM = 1e-3, kMaxRows = 200;
  const double width_m = static_cast<double>(frame.line_count) * in.geometry.line_pitch_m,
               depth_m = static_cast<double>(frame.sample_count) * in.geometry.sample_pitch_m();
  const double nodes = (width_m / kGridDxM + 2) * (depth_m / kGridDyM + 2);
  const double rows = std::min(kMaxRows, std::ceil(in.tissue.depth_m / kFineM)) + 1,
               columns = std::ceil(width_m / kFineM) + 1;
  const ModulusKind method = in.modulus.kind.value_or(ModulusKind::kIterative);  // the most
  constexpr double kAcross = 64, kBeside = 2;                                    // of a solid: a copy of E
  const double direct = in.tissue.plane == Plane::kSolid          ? kBeside * columns * rows * kAcross
                        : method == ModulusKind::kReferenceStress ? 0
                                                                  : 4 * columns * rows * rows;
  const std::uint64_t b_mode = in.b_mode ? BMode::kMaxRows * frame.line_count : 0;
  return {static_cast<std::uint64_t>(nodes * (kMaps * sizeof(float) + 3)) + b_mode,
          static_cast<std::uint64_t>(nodes * kRead * sizeof(float) + direct * sizeof(double))};
}

// Depths from a surface that lies so deep in the image.
void place_below(double surface_m, ModulusInput& input) {
  const auto from_surface = [surface_m](std::function<double(double, double)>& of) {
    if (of) of = [of, surface_m](double x_m, double y_m) { return of(x_m, y_m + surface_m); };
  };
  if (!(input.tissue.depth_m > surface_m + 1e-3))
    throw std::invalid_argument(
        fmt::format("tissue_depth_m: {:.1f} mm, but the tissue begins {:.1f} mm below the probe, under "
                    "coupling; state the depth "
                    "of its far side from the probe's face (of a scene, take a deeper one)",
                    1e3 * input.tissue.depth_m, 1e3 * surface_m));
  input.tissue.depth_m -= surface_m, input.tissue.surface_m = surface_m;
  from_surface(input.known.modulus_pa), from_surface(input.known.log_deviation);
  for (SliceBeside& slice : input.beside) from_surface(slice.modulus_pa);
}

// The modulus is NaN exactly where nothing is said.
void mark_valid(Estimate& e) {
  e.valid.resize(e.grid.size());
  std::ranges::transform(e.modulus.youngs_modulus, e.valid.begin(),
                         [](float v) { return std::isfinite(v) ? 1 : 0; });
  const auto valid = std::ranges::count(e.valid, std::uint8_t{1});
  e.valid_fraction = static_cast<double>(valid) / static_cast<double>(e.grid.size());
}

// With what the frames show to be its cause, if they do: samples that are no RF have no strain at all, and
// echoes of another frequency are taken for others.
TrackingError with_cause(const TrackingError& refusal, const std::vector<Warning>& warnings) {
  const auto cause = std::ranges::find_if(warnings, [&](const Warning& warning) {
    return warning.flag == WarningFlag::kImage || warning.flag == WarningFlag::kAxis ||
           (warning.flag == WarningFlag::kCenterFrequency &&
            refusal.reason == TrackingError::Reason::kDecorrelated);
  });
  if (cause == warnings.end()) return refusal;
  return {refusal.reason, fmt::format("{}; but first: {}", refusal.what(), cause->line())};
}

}  // namespace

Elastography::Elastography(const std::shared_ptr<Device>& device, ElastographyOptions options)
    : queue_(device->queue()),
      strips_(std::make_shared<StripCache>()),
      search_(options.displacement),
      displacement_(queue_, search_),
      strain_(queue_, options.strain),
      b_mode_(queue_),
      modulus_{make_reference_stress(queue_, {}, strips_), make_direct(queue_, {}, strips_),
               make_iterative(queue_, strips_), make_solid(queue_, options.strain, strips_)},
      uncorrected_(make_reference_stress(queue_, {.corrections = 0}, strips_)) {}

void Elastography::charge_to(const MemoryAccount& account) {
  // The buffers and the tissue of another's pair are not this one's to keep.
  if (account.client != queue_.account().client || account.budget != queue_.account().budget)
    displacement_.forget(), modulus_[static_cast<std::size_t>(ModulusKind::kSolid)]->forget();
  queue_.charge_to(account);
  strips_->charge_to(account);
}

void Elastography::warm() {
  // A small and a full-sized frame, looked after: so the kernels are compiled as estimates launch them, in
  // slices.
  const CancellationCheck looked_after([] {});
  for (const auto& [samples, lines] : {std::pair<std::size_t, std::size_t>{256, 16}, {2078, 256}}) {
    AcquisitionGeometry geometry;
    geometry.center_frequency_hz = 7.3e6;
    geometry.sampling_frequency_hz = 40e6;
    geometry.line_pitch_m = 0.235e-3;
    const double width_m = static_cast<double>(lines) * geometry.line_pitch_m;
    const RfFrame pre = texture(samples, lines, 0), post = texture(samples, lines, 0.01);
    try {
      estimate(pre, post, {geometry, std::nullopt, {width_m, 0.040, 0, 0.49}});
    } catch (const TrackingError&) {  // the texture need not be tissue: every kernel before has run
    }
  }
  queue_.finish();
}

void Elastography::judge_tracking(const RfFrame& pre, const RfFrame& post,
                                  const AcquisitionGeometry& geometry, Estimate& e) {
  e.median_correlation = median_correlation(e.correlation);
  if (e.median_correlation >= choices::kMinMedianCorrelation) return;
  const std::string found = fmt::format("pre, post: median correlation {:.2f} is below {:.2f}",
                                        e.median_correlation, choices::kMinMedianCorrelation);
  DisplacementOptions wider = search_;
  wider.max_strain = std::min(kLargestMaxStrain, kWiderSearch * wider.max_strain);
  const DisplacementEstimate again = DisplacementEstimator(queue_, wider).estimate(pre, post, geometry);
  if (median_correlation(queue_.read(again.correlation)) >= choices::kMinMedianCorrelation)
    throw TrackingError(TrackingError::Reason::kBeyondSearch,
                        fmt::format("{}, but the pair can be tracked with max_strain {:.3g}: it is strained "
                                    "beyond max_strain {:.3g}; compress less, or raise it",
                                    found, wider.max_strain, search_.max_strain));
  throw TrackingError(TrackingError::Reason::kDecorrelated,
                      fmt::format("{}; the frames are unrelated, or moved out of plane, or strained beyond "
                                  "{:.3g} (searched up to that; max_strain is {:.3g}): take the pair again "
                                  "with less motion",
                                  found, wider.max_strain, search_.max_strain));
}

DisplacementEstimate Elastography::track(const RfFrame& pre, const RfFrame& post, const EstimateInput& in,
                                         Estimate& e) {
  const AcquisitionGeometry& geometry = in.geometry;
  constexpr double kLongPeriod = 40;  // samples: longer than where it is looked for
  const bool short_period = geometry.sampling_frequency_hz < kLongPeriod * geometry.center_frequency_hz;
  std::optional<Warning> contradicted;
  if (short_period) contradicted = contradicted_rf(pre);
  if (!contradicted) contradicted = contradicted_frequency(pre, geometry);
  if (contradicted) e.input_warnings.push_back(*contradicted);
  // Coupling is left out, and looked at again without it. A pad may look like it.
  const bool may_be_coupled = geometry.frame == DisplacementFrame::kProbe && !in.tissue.pad;
  const Echoes echoes = find_echoes(pre, geometry);
  const int tissue_from = may_be_coupled ? coupling_end(pre, post, echoes) : 0;
  DisplacementEstimate displacement = displacement_.estimate(pre, post, geometry, echoes, tissue_from);
  e.grid = image_grid(displacement.grid, geometry);
  download(queue_, displacement, e);
  if (tissue_from > 0) {
    const double surface_m = geometry.first_sample_depth_m + tissue_from * geometry.sample_pitch_m();
    if (rests_below(surface_m, e)) {
      e.coupling_m = surface_m;
      e.input_warnings.push_back(
          {WarningFlag::kCoupling,
           fmt::format("the upper {:.1f} mm of the image are not tissue: they hardly strain, and end at a "
                       "bright line; the tissue is taken to begin there, and it has no modulus above",
                       1e3 * surface_m)});
    } else {
      displacement = displacement_.estimate(pre, post, geometry, echoes, 0);
      download(queue_, displacement, e);
    }
  }
  judge_tracking(pre, post, geometry, e);
  if (const auto frame = contradicted_frame(geometry, e.grid, e.axial_displacement, e.displacement_valid))
    e.input_warnings.push_back(*frame);
  if (displacement.unsolved)
    e.input_warnings.push_back(
        {WarningFlag::kDisplacement,
         fmt::format("the linear system of a refinement step was left unsolved after {} iterations ({}): the "
                     "displacement is worse than its standard deviation says",
                     displacement.unsolved->iterations, to_string(displacement.unsolved->reason))});
  return displacement;
}

void Elastography::set_max_strain(double max_strain) {
  displacement_.set_max_strain(max_strain);
  search_.max_strain = max_strain;
}

ModulusPlan Elastography::plan(const ModulusInput& input, const ModulusChoice& choice,
                               std::optional<ModulusEstimate>& reference) {
  if (input.tissue.plane == Plane::kSolid) return {ModulusKind::kSolid};
  if (choice.kind) return {*choice.kind};
  reference = uncorrected_->estimate(input);
  return plan_modulus(choice.need, noise_of(input.measured),
                      unevenness(reference->youngs_modulus, reference->background, input.measured.grid),
                      input.budget);
}

ModulusEstimate Elastography::find_modulus(ModulusInput input, const ModulusChoice& choice) {
  if (choice.budget) input.budget = choice.budget();
  try {
    std::optional<ModulusEstimate> reference;
    const ModulusPlan plan = this->plan(input, choice, reference);
    input.tolerance = plan.tolerance;
    if (reference) input.reference = &*reference;
    ModulusEstimate out = modulus_.at(static_cast<std::size_t>(plan.kind))->estimate(input);
    out.why = plan.why;
    return out;
  } catch (const NoCompression& refusal) {
    throw TrackingError(TrackingError::Reason::kNoCompression, std::string("pre, post: ") + refusal.what());
  }
}

Estimate Elastography::estimate(const RfFrame& pre, const RfFrame& post, const EstimateInput& in,
                                const std::function<void(Stage)>& told) {
  validate(pre, post, in.geometry);
  DisplacementEstimator::require_fits(pre, in.geometry, search_);
  const HostBytes bytes = host_bytes(pre, in);
  Estimate e;
  e.held = std::make_shared<const Charge>(queue_.account().charge(Place::kHost, "estimates", bytes.maps));
  const Charge working = queue_.account().charge(Place::kHost, "estimating", bytes.working);
  try {
    estimate_into(pre, post, in, told, e);
  } catch (const TrackingError& refusal) {
    throw with_cause(refusal, e.input_warnings);
  }
  return e;
}

void Elastography::estimate_into(const RfFrame& pre, const RfFrame& post, const EstimateInput& in,
                                 const std::function<void(Stage)>& told, Estimate& e) {
  StageClock clock;
  const auto ended = [&](Stage stage, double& seconds) {
    seconds = clock.lap();
    if (told) told(stage);
    check_cancelled();
  };

  const DisplacementEstimate tracked = track(pre, post, in, e);  // T2.1 to T2.3
  if (in.b_mode) e.b_mode = b_mode_.image(pre, in.geometry);     // T2.9
  ended(Stage::kDisplacement, e.displacement_s);

  const StrainEstimate strained = strain_.estimate(tracked, e.grid);  // T2.4
  download(queue_, strained, e);
  if (e.coupling_m > 0) leave_out_above(e.coupling_m + strain_.options().kernel_axial_m, e);
  ended(Stage::kStrain, e.strain_s);

  // Depths of the tissue are told from its own surface.
  const double first_m = e.grid.origin_y_m;
  e.grid.origin_y_m -= e.coupling_m;
  ModulusInput input{.measured = e,
                     .window_width_m = static_cast<double>(pre.line_count) * in.geometry.line_pitch_m,
                     .tissue = in.tissue,
                     .force = in.force,
                     .known = in.known,
                     .beside = in.beside,
                     .told = in.told,
                     .sound_speed_deviation = in.sound_speed_deviation};
  if (e.coupling_m > 0) place_below(e.coupling_m, input);
  input.tissue = believed(input.tissue, e, strain_.options().kernel_axial_m);
  if (input.tissue.doubted_depth_m > 0) input.tissue.doubted_depth_m = in.tissue.depth_m;
  e.modulus = find_modulus(input, in.modulus);  // T3.1 to T3.3, T3.6, T3.8
  judge(input, *strips_, e.modulus);            // T3.4
  e.grid.origin_y_m = first_m;
  e.modulus.log_modes.grid.origin_y_m += e.coupling_m;
  mark_valid(e);
  ended(Stage::kModulus, e.modulus_s);
}

}  // namespace teletact::service
