// Over 400 lines: sizes of the workspace and the sequence of launches that they are for, which change
// together.
#include "service/imaging/tracking/displacement.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>
#include <vector>

#include "service/device/look.h"
#include "service/imaging/tracking/interpolation.h"
#include "service/imaging/tracking/path_search.h"

namespace teletact::service {
namespace {

constexpr std::size_t kGroup = 32;  // WORK_GROUP of search.cl and displacement.cl
constexpr int kWarpRun = 16;        // WARP_RUN of displacement.cl
constexpr double kCoarseStepAxialM = 1e-3, kCoarseStepLateralM = 2e-3, kFineStepM = 1e-3;
constexpr int kLeastStep = 8;                                  // samples between nodes, for warp
constexpr int kMostCoarseColumns = 48, kMostCoarseRows = 128;  // bound the correlation volume
constexpr int kDecimation = 2;                                 // of the samples of the search windows
constexpr int kNccLaterals = 3;                                // NCC_LATERALS of search.cl
constexpr float kSlopeCost = 0.02f;    // correlation that one sample of lag change per coarse step is worth
constexpr double kMostLags = 1 << 28;  // of the coarse search, all nodes together: 1 GB
constexpr double kLateralStepM = 0.4e-3;              // of the coarse search, about the width of a beam
constexpr float kLateralSlopeCost = 0.25f;            // the same of one lateral step
constexpr int kFilterSamples = 20, kFilterLines = 4;  // reach of the matched filter
constexpr double kLeastPeriods = 4;                   // of the carrier in a coarse window
// Of the strain over part of the depth to the mean compression: a stiff inclusion, the probe's and the
// table's friction leave the softer tissue more than its share.
constexpr double kLocalStrain = 1.6;
constexpr int kSpareLags = 8;  // beyond what the largest strain asks for
constexpr int kFineLags = 8, kFineFirstLag = -4;
constexpr double kTaperFraction = 0.1;  // part of the axial window that its cosine edges take

int steps(double length_m, double step_m) {
  return std::max(1, static_cast<int>(std::lround(length_m / step_m)));
}
int half_width(double window_m, double step_m) {
  return std::max(1, static_cast<int>(std::lround(window_m / 2 / step_m)));
}

// Cosine-tapered axial weights of a window of `size` samples.
std::vector<float> taper(int size) {
  std::vector<float> weights(static_cast<std::size_t>(size));
  const double edge = std::max(1.0, kTaperFraction / 2 * size);
  for (int k = 0; k < size; ++k) {
    const double inside = std::min({1.0, (k + 0.5) / edge, (size - k - 0.5) / edge});
    weights[static_cast<std::size_t>(k)] = static_cast<float>(std::pow(std::sin(inside * M_PI / 2), 2));
  }
  return weights;
}

void require(bool condition, const char* message) {
  if (!condition) throw std::invalid_argument(message);
}

void validate(const DisplacementOptions& o) {
  require(o.max_strain > 0 && o.max_strain <= kLargestMaxStrain,
          "max_strain: must be above 0 and at most 0.125");
  require(o.lateral_search_m >= 0 && o.lateral_search_m <= 5e-3, "lateral_search_m: must be 0 to 5e-3 m");
  require(o.grid_dx_m > 0 && o.grid_dy_m > 0, "grid_dx_m, grid_dy_m: must be above 0 m");
  require(o.window_axial_m > 0 && o.window_axial_m <= 0.02 && o.window_lateral_m > 0 &&
              o.window_lateral_m <= 0.02,
          "window_axial_m, window_lateral_m: must be above 0 and at most 0.02 m");
  require(o.coarse_window_axial_m > 0 && o.coarse_window_axial_m <= 0.02 && o.coarse_window_lateral_m > 0 &&
              o.coarse_window_lateral_m <= 0.02,
          "coarse_window_axial_m, coarse_window_lateral_m: must be above 0 and at most 0.02 m");
  require(o.refinements >= 1 && o.refinements <= 20, "refinements: must be 1 to 20");
}

}  // namespace

struct DisplacementEstimator::Kernels {
  explicit Kernels(const Queue& q) {
    const auto build = [&](const char* name) { return q.kernel("displacement", name, Precision::kFloat); };
    const auto search = [&](const char* name) { return q.kernel("search", name, Precision::kFloat); };
    window_energy = search("window_energy"), best_lateral = search("best_lateral");
    laterals_at = search("laterals_at"), ncc = search("ncc"), ncc_peak = search("ncc_peak");
    warp = build("warp"), gauss_newton = build("gauss_newton");
    median_filter = build("median_filter"), smooth = build("smooth"), resample = build("resample");
    report = build("report");
    window_mean = build("window_mean");
    filter_lines = q.kernel("refinement", "filter_lines", Precision::kFloat);
  }
  Kernel window_energy, best_lateral, laterals_at, ncc, ncc_peak, warp, gauss_newton, median_filter, smooth,
      resample, report, window_mean, filter_lines;
};

// Windows and lags of a search, as ncc() of search.cl takes them.
struct DisplacementEstimator::Search {
  int half_axial, half_lateral, line_stride, first_lag, chunks, laterals, lateral_step;
  float least_reach, reach_slope, lateral_least, lateral_slope;
};

// Sizes and buffers of one geometry.
struct DisplacementEstimator::Workspace {
  Workspace(const RfFrame& frame, const AcquisitionGeometry& geometry, const DisplacementOptions& o);
  void measure(const RfFrame&, const DisplacementOptions&);
  void allocate(const Queue&, const RfFrame&, const DisplacementOptions&);
  std::uint64_t bytes() const;
  bool serves(const RfFrame& frame, const AcquisitionGeometry& g) const {
    return static_cast<int>(frame.sample_count) == samples && static_cast<int>(frame.line_count) == lines &&
           g.sample_pitch_m() == sample_pitch_m && g.line_pitch_m == line_pitch_m &&
           g.center_frequency_hz == center_frequency_hz && g.first_sample_depth_m == first_sample_depth_m &&
           g.frame == frame_kind;
  }

  int samples, lines;
  double sample_pitch_m, line_pitch_m, center_frequency_hz, first_sample_depth_m;
  DisplacementFrame frame_kind;
  float period;                            // of the carrier, samples
  float least_reach = 0, reach_slope = 0;  // of the axial search, samples: least + slope * sample
  int coarse_half_axial, coarse_half_lateral, coarse_lateral_step, coarse_laterals;
  float lateral_least,
      lateral_slope;  // of the coarse lateral search, lines: slope * distance from the middle
  int coarse_chunks, coarse_first_lag;
  int half_axial, half_lateral, lateral_reach, window_chunks;
  SampleGrid coarse, fine, image;
  Padding pad;
  Array<float> pre, post, mean, difference;  // padded images; `mean` also holds a warped post
  // The windows of Gauss-Newton; their tapered part counts half.
  WindowResponse window() const {
    return {(half_lateral + 0.5) / image.line_step,
            (1 - kTaperFraction / 2) * 4.0 * window_chunks / image.sample_step};
  }
  Array<float> filtered_pre, filtered_post;
  std::unique_ptr<Refinement> refinement;
  bool matched = false;  // the refinement works on the filtered frames
  Array<float> taps, series, weights;
  Array<float> pre_energy, post_energy;  // of the search windows
  Array<float> coarse_volume, fine_volume, best_lateral, laterals_at;
  Array<int> axial_lags;
  Array<float> field, candidate, filtered, correlation, deviation;  // fields: 2 per node of the largest grid
  Array<float> field_m, std_m, information;
  std::shared_ptr<const NoiseStructure> noise;
  Array<std::uint8_t> trusted;
};

// The sizes; allocate() is still to come. Of the frame no sample is read.
DisplacementEstimator::Workspace::Workspace(const RfFrame& frame, const AcquisitionGeometry& g,
                                            const DisplacementOptions& o)
    : samples(static_cast<int>(frame.sample_count)),
      lines(static_cast<int>(frame.line_count)),
      sample_pitch_m(g.sample_pitch_m()),
      line_pitch_m(g.line_pitch_m),
      center_frequency_hz(g.center_frequency_hz),
      first_sample_depth_m(g.first_sample_depth_m),
      frame_kind(g.frame),
      period(static_cast<float>(g.sampling_frequency_hz / g.center_frequency_hz)) {
  measure(frame, o);
  if (double(coarse.nodes()) * coarse_laterals * 8 * coarse_chunks > kMostLags)
    throw std::invalid_argument(
        "max_strain: the search of so many lines and samples would not fit in memory; give a smaller one, or "
        "a part "
        "of the frame");
}

void DisplacementEstimator::Workspace::measure(const RfFrame& frame, const DisplacementOptions& o) {
  const double dy = sample_pitch_m, dx = line_pitch_m;
  coarse = centred_grid(frame, std::max(steps(kCoarseStepLateralM, dx), lines / kMostCoarseColumns),
                        std::max({kLeastStep, steps(kCoarseStepAxialM, dy), samples / kMostCoarseRows}));
  fine = centred_grid(frame, steps(kFineStepM, dx), std::max(kLeastStep, steps(kFineStepM, dy)));
  image = centred_grid(frame, steps(o.grid_dx_m, dx), std::max(kLeastStep, steps(o.grid_dy_m, dy)));
  // Under the largest strain the echoes of one window may not move apart by more than half a period.
  const double widest_m = std::max(kLeastPeriods, 0.5 / o.max_strain) * period * dy;
  coarse_half_axial = std::min(half_width(std::min(o.coarse_window_axial_m, widest_m), dy), samples / 2);
  coarse_half_lateral = std::min(half_width(o.coarse_window_lateral_m, dx), lines / 2);
  // Nearly incompressible tissue widens by what it is compressed by, about the middle of the probe.
  const bool sideways = o.lateral_search_m > 0;
  // The fine search looks half of lateral_search_m further.
  lateral_least = static_cast<float>(o.lateral_search_m / 2 / dx);
  lateral_slope = sideways ? static_cast<float>(o.max_strain) : 0.0f;
  const float lateral_most = std::max(lateral_least, lateral_slope * static_cast<float>(lines) / 2);
  coarse_lateral_step = std::min(steps(kLateralStepM, dx), lines);
  coarse_laterals =
      1 + 2 * static_cast<int>(std::ceil(std::min<float>(lateral_most, static_cast<float>(lines)) /
                                         static_cast<float>(coarse_lateral_step)));
  // The probe's face at rest, nothing moves further than the local strain over the depth above it; else the
  // deepest sample's reach holds everywhere.
  const double deepest_m = first_sample_depth_m + samples * dy;
  const bool probe_rests = frame_kind == DisplacementFrame::kProbe;
  const double least_m = o.max_strain * (probe_rests ? first_sample_depth_m : deepest_m);
  least_reach = static_cast<float>(least_m / dy + kSpareLags);
  reach_slope = static_cast<float>(probe_rests ? kLocalStrain * o.max_strain : 0.0);
  const int most_lag =
      static_cast<int>(std::min<double>(samples, std::ceil(o.max_strain * deepest_m / dy) + kSpareLags));
  coarse_chunks = 2 * ((most_lag + 7) / 8);
  coarse_first_lag = -4 * coarse_chunks;
  half_axial = std::min(half_width(o.window_axial_m, dy), samples / 2);
  half_lateral = std::min(static_cast<int>(std::lround(o.window_lateral_m / 2 / dx)), lines / 2);
  lateral_reach =
      sideways ? std::max(coarse_lateral_step / 2, static_cast<int>(std::lround(lateral_least))) + 1 : 0;
  window_chunks = std::max(1, (2 * half_axial + 4) / 8);
}

void DisplacementEstimator::Workspace::allocate(const Queue& q, const RfFrame& frame,
                                                const DisplacementOptions& o) {
  pad = padding(frame, 4 * coarse_chunks + 4 * window_chunks + coarse_half_axial + half_axial + 16,
                std::max(coarse_half_lateral + coarse_laterals / 2 * coarse_lateral_step,
                         half_lateral + lateral_reach) +
                    3);
  q.account().make_room(Place::kDevice, "arrays", bytes());
  for (Array<float>* image_array :
       {&pre, &post, &mean, &difference, &filtered_pre, &filtered_post, &pre_energy, &post_energy}) {
    *image_array = q.array<float>(pad.total);
    q.fill_zero(*image_array);
  }
  taps = q.array(interpolation_taps());
  series = q.array(interpolation_series());
  weights = q.array(taper(8 * window_chunks));
  coarse_volume =
      q.array<float>(std::size_t(coarse.nodes()) * std::size_t(coarse_laterals) * 8 * coarse_chunks);
  q.fill_zero(coarse_volume);  // where nothing is looked at
  best_lateral = q.array<float>(std::size_t(coarse.nodes()) * 8 * coarse_chunks);
  laterals_at = q.array<float>(std::size_t(coarse.nodes()) * std::size_t(coarse_laterals));
  axial_lags = q.array<int>(std::size_t(coarse.nodes()));
  fine_volume = q.array<float>(std::size_t(fine.nodes()) * (2 * lateral_reach + 1) * kFineLags);
  const auto nodes = std::size_t(std::max({coarse.nodes(), fine.nodes(), image.nodes()}));
  for (Array<float>* array : {&field, &candidate, &filtered}) *array = q.array<float>(2 * nodes);
  correlation = q.array<float>(nodes);
  deviation = q.array<float>(nodes);
  for (Array<float>* array : {&field_m, &std_m, &information})
    *array = q.array<float>(2 * std::size_t(image.nodes()));
  trusted = q.array<std::uint8_t>(std::size_t(image.nodes()));
  refinement = std::make_unique<Refinement>(q, o.regularisation, image, line_pitch_m, sample_pitch_m);
}

// About what allocate() and the refinement take: asked for as a whole, so that nothing is taken in vain.
std::uint64_t DisplacementEstimator::Workspace::bytes() const {
  constexpr std::uint64_t kImages = 8, kPerImageNode = 90 + 9, kPerNode = 8;  // floats
  const auto of = [](const SampleGrid& g) { return static_cast<std::uint64_t>(g.nodes()); };
  const auto laterals = static_cast<std::uint64_t>(coarse_laterals),
             lags = 8 * static_cast<std::uint64_t>(coarse_chunks),
             fine_laterals = 2 * static_cast<std::uint64_t>(lateral_reach) + 1;
  const std::uint64_t volumes = of(coarse) * (laterals * lags + lags + laterals + 1) +
                                of(fine) * fine_laterals * kFineLags,
                      nodes = std::max({of(coarse), of(fine), of(image)});
  return sizeof(float) * (kImages * pad.total + volumes + kPerNode * nodes + kPerImageNode * of(image));
}

void DisplacementEstimator::require_fits(const RfFrame& frame, const AcquisitionGeometry& geometry,
                                         const DisplacementOptions& options) {
  Workspace(frame, geometry, options);
}

DisplacementEstimator::DisplacementEstimator(Queue queue, DisplacementOptions options)
    : queue_(std::move(queue)), options_(options) {
  validate(options_);
  kernels_ = std::make_unique<Kernels>(queue_);
}

DisplacementEstimator::~DisplacementEstimator() = default;

void DisplacementEstimator::forget() {
  work_.reset();
}

void DisplacementEstimator::set_max_strain(double max_strain) {
  if (max_strain == options_.max_strain) return;
  DisplacementOptions other = options_;
  other.max_strain = max_strain;
  validate(other);
  options_ = other;
  work_.reset();
}

namespace {

// One item per kWarpRun samples of a line.
Range over_samples(int samples, int lines) {
  const auto runs = static_cast<std::size_t>((samples + kWarpRun - 1) / kWarpRun);
  return {{runs, static_cast<std::size_t>(lines), 1}, {16, 1, 1}};
}

Range over(int nodes) {
  return {{static_cast<std::size_t>(nodes), 1, 1}, {kGroup, 1, 1}};
}

}  // namespace

// `volume`: correlations of the windows around the nodes of `g`.
void DisplacementEstimator::correlate(const SampleGrid& g, const Search& s, const Array<float>& post,
                                      Array<float>& volume) {
  Workspace& w = *work_;
  const auto energy = [&](const Array<float>& image, Array<float>& out, int first, int step, int count) {
    kernels_->window_energy(
        {{static_cast<std::size_t>(count), static_cast<std::size_t>(w.lines), 1}, {16, 1, 1}}, image, out,
        first, step, count, s.half_axial, kDecimation, w.pad.origin, w.pad.stride);
  };
  energy(w.pre, w.pre_energy, g.first_sample, g.sample_step, g.ny);  // at the nodes alone
  const int margin = s.half_axial + 8;                               // echoes end so far outside of the frame
  if (s.chunks == 1)
    energy(post, w.post_energy, g.first_sample + s.first_lag, g.sample_step, g.ny);
  else
    energy(post, w.post_energy, -margin, 8, (w.samples + 2 * margin + 7) / 8);
  const int groups = (s.laterals + kNccLaterals - 1) / kNccLaterals;
  kernels_->ncc(over(g.nodes() * groups * s.chunks), w.pre, post, w.pre_energy, w.post_energy, volume, g.nx,
                g.ny, g.first_line, g.line_step, g.first_sample, g.sample_step, w.pad.origin, w.pad.stride,
                s.half_axial, s.half_lateral, kDecimation, s.line_stride, s.first_lag, s.chunks,
                -(s.laterals / 2) * s.lateral_step, s.lateral_step, s.laterals, s.least_reach, s.reach_slope,
                s.lateral_least, s.lateral_slope);
}

// Level 1: `field` on the coarse grid.
void DisplacementEstimator::search_coarse() {
  Workspace& w = *work_;
  const SampleGrid& g = w.coarse;
  correlate(g,
            {w.coarse_half_axial, w.coarse_half_lateral, w.coarse_lateral_step, w.coarse_first_lag,
             w.coarse_chunks, w.coarse_laterals, w.coarse_lateral_step, w.least_reach, w.reach_slope,
             w.lateral_least, w.lateral_slope},
            w.post, w.coarse_volume);
  kernels_->best_lateral(over(g.nodes() * w.coarse_chunks), w.coarse_volume, w.best_lateral, g.nodes(),
                         w.coarse_chunks, w.coarse_laterals);
  const LagVolume volume{g.nx, g.ny, 8 * w.coarse_chunks, queue_.read(w.best_lateral)};
  look();
  const auto reach = [&](double length_m) {  // samples that the lag may change by over this length
    return static_cast<int>(std::ceil(options_.max_strain * length_m / w.sample_pitch_m)) + 1;
  };
  const std::vector<float> axial = find_paths(volume, reach(g.sample_step * w.sample_pitch_m),
                                              reach(g.line_step * w.line_pitch_m), kSlopeCost);
  std::vector<int> whole;
  whole.reserve(axial.size());
  for (const float lag : axial) whole.push_back(static_cast<int>(std::lround(lag)));
  queue_.write(w.axial_lags, whole.data(), whole.size());
  kernels_->laterals_at(over(g.nodes() * w.coarse_laterals), w.coarse_volume, w.axial_lags, w.laterals_at,
                        g.nodes(), w.coarse_chunks, w.coarse_laterals);
  const std::vector<float> lateral =
      find_paths({g.nx, g.ny, w.coarse_laterals, queue_.read(w.laterals_at)}, 1, 1, kLateralSlopeCost);
  std::vector<float> field;
  const int middle = w.coarse_laterals / 2;
  for (std::size_t n = 0; n < axial.size(); ++n) {
    field.push_back((lateral[n] - static_cast<float>(middle)) * static_cast<float>(w.coarse_lateral_step));
    field.push_back(static_cast<float>(w.coarse_first_lag) + axial[n]);
  }
  queue_.write(w.candidate, field.data(), field.size());
  kernels_->smooth(over(g.nodes()), w.candidate, w.field, g.nx, g.ny);
}

// Level 2: `field` from the coarse onto the fine grid.
void DisplacementEstimator::search_fine() {
  Workspace& w = *work_;
  const SampleGrid &c = w.coarse, &g = w.fine;
  const int lateral_count = 2 * w.lateral_reach + 1;
  warp(c, false);
  correlate(g,
            {w.half_axial, w.half_lateral, w.coarse_lateral_step, kFineFirstLag, 1, lateral_count, 1, 8.0f,
             0.0f, static_cast<float>(w.lateral_reach), 0.0f},
            w.mean, w.fine_volume);
  kernels_->resample(over(g.nodes()), w.field, w.filtered, c.nx, c.ny, c.first_line, c.line_step,
                     c.first_sample, c.sample_step, g.nx, g.ny, g.first_line, g.line_step, g.first_sample,
                     g.sample_step);
  kernels_->ncc_peak(over(g.nodes()), w.fine_volume, w.filtered, w.candidate, w.correlation, g.nodes(),
                     kFineFirstLag, -w.lateral_reach, lateral_count);
  const auto threshold = static_cast<float>(options_.trusted_correlation - 0.2);
  kernels_->median_filter(over(g.nodes()), w.candidate, w.filtered, w.correlation, w.field, w.deviation, g.nx,
                          g.ny, 2, threshold, 0.5f, 0.15f * w.period);
  kernels_->smooth(over(g.nodes()), w.field, w.candidate, g.nx, g.ny);
  kernels_->smooth(over(g.nodes()), w.candidate, w.field, g.nx, g.ny);
}

// Level 3: `filtered`, `correlation`, `deviation` on the image grid from `field` on the fine grid.
void DisplacementEstimator::refine(std::optional<PcgResult>& unsolved) {
  Workspace& w = *work_;
  const SampleGrid &f = w.fine, &g = w.image;
  const auto threshold = static_cast<float>(options_.trusted_correlation);
  const auto tolerance = static_cast<float>(options_.outlier_distance_m / w.sample_pitch_m);
  kernels_->resample(over(g.nodes()), w.field, w.candidate, f.nx, f.ny, f.first_line, f.line_step,
                     f.first_sample, f.sample_step, g.nx, g.ny, g.first_line, g.line_step, g.first_sample,
                     g.sample_step);
  std::swap(w.field, w.candidate);
  const bool regularised = options_.method == RefinementMethod::kRegularised;
  for (int n = 0; n < options_.refinements; ++n) {
    const bool last = n + 1 == options_.refinements;
    if (n > 0 && regularised) std::swap(w.filtered, w.field);
    if (n > 0 && !regularised) kernels_->smooth(over(g.nodes()), w.filtered, w.field, g.nx, g.ny);
    warp(g, true);
    const Autocorrelations a =
        w.refinement->measure({w.mean, w.difference, w.pad, w.samples, w.lines}, last, w.correlation);
    if (regularised) {
      w.refinement->step(w.field, w.candidate, 1.0f, 0.25f * w.period, last);
      if (w.refinement->solved().reason != StopReason::kConverged) unsolved = w.refinement->solved();
    } else {
      fit_windows();
    }
    if (n + 2 == options_.refinements) filter_frames(a);
    kernels_->median_filter(over(g.nodes()), w.candidate, w.field, w.correlation, w.filtered, w.deviation,
                            g.nx, g.ny, 2, threshold, 0.25f, tolerance);
  }
  w.noise = regularised ? w.refinement->uncertainty(w.filtered, options_.refinements, w.information, w.std_m)
                        : w.refinement->uncertainty(w.window(), w.information, w.std_m);
}

// `candidate` from `field`, each window by itself.
void DisplacementEstimator::fit_windows() {
  Workspace& w = *work_;
  const SampleGrid& g = w.image;
  const WindowResponse window = w.window();
  const float lateral_limit = options_.lateral_search_m > 0 ? 1.0f : 0.0f;
  kernels_->window_mean(over(g.nodes()), w.field, w.filtered, g.nx, g.ny,
                        static_cast<float>(window.half_along), static_cast<float>(window.half_down));
  kernels_->gauss_newton(over(g.nodes()), w.mean, w.difference, w.filtered, w.weights, w.candidate,
                         w.correlation, g.nx, g.ny, g.first_line, g.line_step, g.first_sample, g.sample_step,
                         w.pad.origin, w.pad.stride, w.window_chunks, w.half_lateral, 0.25f * w.period,
                         lateral_limit);
}

void DisplacementEstimator::warp(const SampleGrid& g, bool pair) {
  Workspace& w = *work_;
  const Array<float>&pre = w.matched ? w.filtered_pre : w.pre, &post = w.matched ? w.filtered_post : w.post;
  kernels_->warp(over_samples(w.samples, w.lines), pre, post, w.field, w.taps, w.series, w.mean, w.difference,
                 pair ? 1 : 0, kInterpolationPhases, w.lines, w.samples, g.nx, g.ny, g.first_line,
                 g.line_step, g.first_sample, g.sample_step, w.pad.origin, w.pad.stride);
}

void DisplacementEstimator::filter_frames(const Autocorrelations& a) {
  Workspace& w = *work_;
  MatchedFilter filter = matched_filter(a, kFilterSamples, kFilterLines);
  if (!(options_.lateral_search_m > 0)) {  // each line by itself
    filter.lateral.assign(kFilterLines + 1, 0.0f);
    filter.lateral[0] = 1;
  }
  const Array<float> axial = queue_.array(filter.axial), lateral = queue_.array(filter.lateral);
  const Range range{{static_cast<std::size_t>(w.samples + 7) / 8, static_cast<std::size_t>(w.lines), 1},
                    {16, 1, 1}};
  const auto both = [&](const Array<float>& from, Array<float>& to) {  // `mean` is free between two steps
    kernels_->filter_lines(range, from, w.mean, axial, kFilterSamples, 1, w.samples, w.pad.origin,
                           w.pad.stride);
    kernels_->filter_lines(range, w.mean, to, lateral, kFilterLines, w.pad.stride, w.samples, w.pad.origin,
                           w.pad.stride);
  };
  both(w.pre, w.filtered_pre);
  both(w.post, w.filtered_post);
  w.matched = true;
}

DisplacementEstimate DisplacementEstimator::estimate(const RfFrame& pre, const RfFrame& post,
                                                     const AcquisitionGeometry& geometry) {
  if (work_ && !work_->serves(pre, geometry)) work_.reset();  // first: its room may be needed
  if (!work_) {
    auto work = std::make_unique<Workspace>(pre, geometry, options_);
    work->allocate(queue_, pre, options_);
    work_ = std::move(work);
  }
  Workspace& w = *work_;
  queue_.write(w.pre, padded(pre, w.pad).data(), w.pad.total);
  queue_.write(w.post, padded(post, w.pad).data(), w.pad.total);
  w.matched = false;
  search_coarse();
  search_fine();
  look();
  std::optional<PcgResult> unsolved;
  refine(unsolved);
  kernels_->report(over(w.image.nodes()), w.filtered, w.correlation, w.deviation, w.field_m, w.trusted,
                   w.image.nodes(), static_cast<float>(w.line_pitch_m), static_cast<float>(w.sample_pitch_m),
                   static_cast<float>(options_.trusted_correlation),
                   static_cast<float>(options_.outlier_distance_m / w.sample_pitch_m));
  return {w.image, w.field_m, w.correlation, w.trusted, w.std_m, w.information, w.noise, unsolved};
}

}  // namespace teletact::service
