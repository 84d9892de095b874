#include "service/imaging/estimate.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <numbers>
#include <random>
#include <string>
#include <utility>

#include "service/device/cancellation.h"
#include "service/device/worked.h"
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

// What is left by now, of a modulus that was begun then.
ModulusTime time_of(const ModulusChoice& choice, double begun_s) {
  ModulusTime time = choice.time ? choice.time() : ModulusTime{};
  if (!choice.time_limit_s) return time;
  const double left_s = *choice.time_limit_s - (worked_s() - begun_s);
  if (left_s < time.left_s.value_or(HUGE_VAL)) time.left_s = left_s, time.words = "modulus_time_limit_s";
  return time;
}

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

}  // namespace

Elastography::Elastography(const std::shared_ptr<Device>& device, ElastographyOptions options)
    : queue_(device->queue()),
      strips_(std::make_shared<StripCache>()),
      options_(options),
      displacement_(queue_, options.displacement),
      strain_(queue_, options.strain),
      b_mode_(queue_) {
  modulus_ = {make_reference_stress(queue_, options.reference_stress, strips_),
              make_direct(queue_, options.direct, strips_),
              make_iterative(queue_, options.iterative, options.direct, strips_),
              make_solid(queue_, options.solid, strips_)};
  ReferenceStressOptions uncorrected = options.reference_stress;
  uncorrected.corrections = 0;
  uncorrected_ = make_reference_stress(queue_, uncorrected, strips_);
  judge_ = std::make_unique<ModulusJudge>(strips_, JudgeLimits{}, options.direct.reach);
  if (!(options_.min_median_correlation > 0 && options_.min_median_correlation < 1))
    throw std::invalid_argument("min_median_correlation: must be above 0 and below 1");
}

void Elastography::charge_to(const MemoryAccount& account) {
  // What another's pair left behind is not this one's to keep.
  if (account.client != queue_.account().client || account.budget != queue_.account().budget)
    displacement_.forget(), modulus_[static_cast<std::size_t>(ModulusKind::kSolid)]->forget();
  queue_.charge_to(account);
  strips_->charge_to(account);
}

namespace {

struct HostBytes {
  std::uint64_t maps, working;
};

// Maps on the image grid, and meanwhile what they are read from the device as and the blocks of the direct
// modulus (T3.2), which the iterative one starts from: four of ny^2 for each column of nodes, 1 mm apart.
HostBytes host_bytes(const RfFrame& frame, const EstimateInput& in) {
  constexpr double kMaps = 13, kRead = 20, kFineM = 1e-3, kMaxRows = 200;
  const double width_m = static_cast<double>(frame.line_count) * in.geometry.line_pitch_m,
               depth_m = static_cast<double>(frame.sample_count) * in.geometry.sample_pitch_m();
  const double nodes = (width_m / kGridDxM + 2) * (depth_m / kGridDyM + 2);
  const double rows = std::min(kMaxRows, std::ceil(in.tissue.depth_m / kFineM)) + 1,
               columns = std::ceil(width_m / kFineM) + 1;
  const ModulusKind method = in.modulus.kind.value_or(ModulusKind::kIterative);  // the most
  constexpr double kAcross = 64, kBeside = 2, kOfElement = 2;                    // of a solid: E and its copy
  const double direct = in.tissue.plane == Plane::kSolid ? kOfElement * kBeside * columns * rows * kAcross
                        : method == ModulusKind::kReferenceStress ? 0
                                                                  : 4 * columns * rows * rows;
  const std::uint64_t b_mode = in.b_mode ? BMode::kMaxRows * frame.line_count : 0;
  return {static_cast<std::uint64_t>(nodes * (kMaps * sizeof(float) + 3)) + b_mode,
          static_cast<std::uint64_t>(nodes * kRead * sizeof(float) + direct * sizeof(double))};
}

}  // namespace

void Elastography::warm() {
  // A small and a full-sized frame, looked after: so the kernels are compiled as estimates launch them, in
  // slices.
  for (const auto& [samples, lines] : {std::pair<std::size_t, std::size_t>{256, 16}, {2078, 256}}) {
    AcquisitionGeometry geometry;
    geometry.center_frequency_hz = 7.3e6;
    geometry.sampling_frequency_hz = 40e6;
    geometry.line_pitch_m = 0.235e-3;
    const double width_m = static_cast<double>(lines) * geometry.line_pitch_m;
    const RfFrame pre = texture(samples, lines, 0), post = texture(samples, lines, 0.01);
    try {
      estimate(pre, post, {geometry, std::nullopt, {width_m, 0.040, 0, 0.49}}, {{}, [] { return false; }});
    } catch (const TrackingError&) {  // the texture need not be tissue: every kernel before has run
    }
  }
  queue_.finish();
}

void Elastography::judge_tracking(const RfFrame& pre, const RfFrame& post,
                                  const AcquisitionGeometry& geometry, Estimate& e) {
  e.median_correlation = median_correlation(e.correlation);
  if (e.median_correlation >= options_.min_median_correlation) return;
  const std::string found = fmt::format("pre, post: median correlation {:.2f} is below {:.2f}",
                                        e.median_correlation, options_.min_median_correlation);
  DisplacementOptions wider = options_.displacement;
  wider.max_strain = std::min(kLargestMaxStrain, kWiderSearch * wider.max_strain);
  const DisplacementEstimate again = DisplacementEstimator(queue_, wider).estimate(pre, post, geometry);
  if (median_correlation(queue_.read(again.correlation)) >= options_.min_median_correlation)
    throw TrackingError(TrackingError::Reason::kBeyondSearch,
                        fmt::format("{}, but the pair can be tracked with max_strain {:.3g}: it is strained "
                                    "beyond max_strain {:.3g}; compress less, or raise it",
                                    found, wider.max_strain, options_.displacement.max_strain));
  throw TrackingError(
      TrackingError::Reason::kDecorrelated,
      fmt::format("{}; the frames are unrelated, or moved out of plane, or strained beyond "
                  "{:.3g} (searched up to that; max_strain is {:.3g}): take the pair again "
                  "with less motion{}",
                  found, wider.max_strain, options_.displacement.max_strain,
                  e.input_warnings.empty() ? "" : "; but first: " + e.input_warnings.front()));
}

DisplacementEstimate Elastography::track(const RfFrame& pre, const RfFrame& post,
                                         const AcquisitionGeometry& geometry, Estimate& e) {
  DisplacementEstimate displacement = displacement_.estimate(pre, post, geometry);
  e.grid = image_grid(displacement.grid, geometry);
  download(queue_, displacement, e);
  if (auto text = contradicted_frequency(pre, geometry)) e.input_warnings.push_back(*text);
  judge_tracking(pre, post, geometry, e);
  if (auto text = contradicted_frame(geometry, e.grid, e.axial_displacement, e.displacement_valid))
    e.input_warnings.push_back(*text);
  if (displacement.unsolved)
    e.input_warnings.push_back(
        "displacement: the linear system of a refinement step was left unsolved after " +
        std::to_string(displacement.unsolved->iterations) + " iterations (" +
        to_string(displacement.unsolved->reason) +
        "): the displacement is worse than its standard deviation says");
  return displacement;
}

void Elastography::set_max_strain(double max_strain) {
  displacement_.set_max_strain(max_strain);
  options_.displacement.max_strain = max_strain;
}

ModulusPlan Elastography::plan(const ModulusInput& input, const ModulusChoice& choice,
                               const ModulusTime& time, std::optional<ModulusEstimate>& reference) {
  if (input.tissue.plane == Plane::kSolid) return {ModulusKind::kSolid};
  if (choice.kind) return {*choice.kind};
  reference = uncorrected_->estimate(input);
  return plan_modulus(choice.need, noise_of(input.measured),
                      unevenness(reference->youngs_modulus, reference->background, input.measured.grid),
                      time);
}

void Elastography::find_modulus(ModulusInput input, const ModulusChoice& choice, Estimate& e) {
  const auto time = [&choice, begun_s = worked_s()] { return time_of(choice, begun_s); };
  if (time().left_s) input.seconds_left = [&time] { return *time().left_s; };
  try {
    std::optional<ModulusEstimate> reference;
    const ModulusPlan plan = this->plan(input, choice, time(), reference);
    input.tolerance = plan.tolerance;
    if (reference) input.reference = &*reference;
    e.modulus = modulus_.at(static_cast<std::size_t>(plan.kind))->estimate(input);
    e.modulus.why = plan.why;
    judge_->judge(input, e.modulus);
  } catch (const NoCompression& refusal) {
    throw TrackingError(TrackingError::Reason::kNoCompression, std::string("pre, post: ") + refusal.what());
  }
  e.valid.resize(e.grid.size());
  for (std::size_t n = 0; n < e.valid.size(); ++n)
    e.valid[n] = std::isfinite(e.modulus.youngs_modulus[n]) ? 1 : 0;
  const auto valid = std::count(e.valid.begin(), e.valid.end(), std::uint8_t{1});
  e.valid_fraction = static_cast<double>(valid) / static_cast<double>(e.grid.size());
}

Estimate Elastography::estimate(const RfFrame& pre, const RfFrame& post, const EstimateInput& in,
                                const EstimateObserver& observer) {
  std::optional<CancellationCheck> check;
  if (observer.cancelled)
    check.emplace([&observer] {
      if (observer.cancelled()) throw EstimateCancelled();
    });
  validate(pre, post, in.geometry);
  DisplacementEstimator::require_fits(pre, in.geometry, options_.displacement);
  const HostBytes bytes = host_bytes(pre, in);
  Estimate e;
  e.held = std::make_shared<const Charge>(queue_.account().charge(Place::kHost, "estimates", bytes.maps));
  const Charge working = queue_.account().charge(Place::kHost, "estimating", bytes.working);
  StageClock clock;
  const auto ended = [&](Stage stage, double& seconds) {
    seconds = clock.lap();
    if (observer.progress) observer.progress(stage);
    check_cancelled();
  };
  const DisplacementEstimate displacement = track(pre, post, in.geometry, e);
  if (in.b_mode) e.b_mode = b_mode_.image(pre, in.geometry);
  ended(Stage::kDisplacement, e.displacement_s);
  download(queue_, strain_.estimate(displacement, e.grid), e);
  ended(Stage::kStrain, e.strain_s);
  const double window_width_m = static_cast<double>(pre.line_count) * in.geometry.line_pitch_m;
  ModulusInput input{e, window_width_m, in.tissue, in.force, in.known};
  input.beside = in.beside;
  find_modulus(std::move(input), in.modulus, e);
  ended(Stage::kModulus, e.modulus_s);
  return e;
}

}  // namespace teletact::service
