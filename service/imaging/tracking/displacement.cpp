#include "service/imaging/tracking/displacement.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>
#include <vector>

#include "service/device/cancellation.h"
#include "service/imaging/tracking/interpolation.h"
#include "service/imaging/tracking/sample_grid.h"
#include "service/imaging/tracking/search.h"

namespace teletact::service {
namespace {

constexpr int kWarpRun = 16;                          // WARP_RUN of displacement.cl
constexpr int kFilterRun = 16;                        // samples of an item of filter_lines
constexpr int kFilterSamples = 20, kFilterLines = 4;  // reach of the matched filter
// From what holds no echo: half of the strain's kernel.
constexpr double kEchoesAxialM = 1.25e-3, kEchoesLateralM = 1e-3;
constexpr double kOutlierDistanceM = 12e-6;  // from the median of the neighbours' corrections, axially

double checked(double max_strain) {
  if (!(max_strain > 0 && max_strain <= kLargestMaxStrain))
    throw std::invalid_argument("max_strain: must be above 0 and at most 0.125");
  return max_strain;
}

}  // namespace

struct DisplacementEstimator::Kernels {
  explicit Kernels(const Queue& q) : search(q) {
    const auto build = [&](const char* name) { return q.kernel("displacement", name, Precision::kFloat); };
    warp = build("warp"), median_filter = build("median_filter"), smooth = build("smooth");
    resample = build("resample"), report = build("report");
    filter_lines = q.kernel("refinement", "filter_lines", Precision::kFloat);
  }
  SearchKernels search;
  Kernel warp, median_filter, smooth, resample, report, filter_lines;
};

// Sizes and buffers of one geometry.
struct DisplacementEstimator::Workspace {
  // The sizes; allocate() is still to come. Of the frame no sample is read.
  Workspace(const RfFrame&, const AcquisitionGeometry&, const DisplacementOptions&);
  void allocate(const Queue&, const DisplacementOptions&);
  std::uint64_t bytes() const;
  bool serves(const RfFrame& frame, const AcquisitionGeometry& g) const {
    return static_cast<int>(frame.sample_count) == plan.samples &&
           static_cast<int>(frame.line_count) == plan.lines && g == geometry;
  }
  struct Frames {
    Array<float> pre, post;  // padded
  };

  AcquisitionGeometry geometry;
  SearchPlan plan;
  float period;  // of the carrier, samples
  Padding pad;
  Frames frames, filtered_frames;
  Charge held;                                              // of these two:
  std::shared_ptr<std::vector<float>> host_pre, host_post;  // the frames on their way to the device
  bool matched = false;                                     // the refinement works on the filtered frames
  Array<float> mean, difference;                            // of the pair; `mean` also holds a warped post
  Array<float> taps, series;                                // of interpolation
  Array<float> field, candidate, filtered;                  // 2 per node of the largest grid
  Array<float> deviation;                                   // 1 per node
  // 1 per line: where it holds echoes, and where it does so all about.
  Array<EchoSpan> pre_spans, post_spans, pre_inner, post_inner;
  std::unique_ptr<Search> search;
  std::unique_ptr<Refinement> refinement;
  DisplacementEstimate found;  // on the image grid; correlation is that of every level
};

DisplacementEstimator::Workspace::Workspace(const RfFrame& frame, const AcquisitionGeometry& g,
                                            const DisplacementOptions& o)
    : geometry(g),
      plan(frame, g, o.max_strain),
      period(static_cast<float>(g.sampling_frequency_hz / g.center_frequency_hz)),
      pad(padding(frame, plan.margin_samples() + plan.fine.window.half_axial + 4, plan.margin_lines())) {
  found.grid = centred_grid(frame, whole_steps(kGridDxM, plan.line_pitch_m),
                            std::max(kMinStep, whole_steps(kGridDyM, plan.sample_pitch_m)));
}

void DisplacementEstimator::Workspace::allocate(const Queue& q, const DisplacementOptions& o) {
  q.account().make_room(q.place(), "arrays", bytes());
  for (Array<float>* image :
       {&frames.pre, &frames.post, &mean, &difference, &filtered_frames.pre, &filtered_frames.post}) {
    *image = q.array<float>(pad.total);
    q.fill_zero(*image);
  }
  held = q.account().charge(Place::kHost, "frames", 2 * sizeof(float) * pad.total);
  taps = q.array(interpolation_taps());
  series = q.array(interpolation_series());
  search = std::make_unique<Search>(q, plan, pad);
  const auto image_nodes = static_cast<std::size_t>(found.grid.nodes()),
             nodes = std::max({plan.coarse.nodes(), plan.fine.nodes(), image_nodes});
  for (Array<float>* array : {&field, &candidate, &filtered}) *array = q.array<float>(2 * nodes);
  for (Array<float>* array : {&found.correlation, &deviation}) *array = q.array<float>(nodes);
  for (Array<float>* array : {&found.field_m, &found.std_m, &found.information})
    *array = q.array<float>(2 * image_nodes);
  found.trusted = q.array<std::uint8_t>(image_nodes);
  for (Array<EchoSpan>* spans : {&pre_spans, &post_spans, &pre_inner, &post_inner})
    *spans = q.array<EchoSpan>(static_cast<std::size_t>(plan.lines));
  refinement =
      std::make_unique<Refinement>(q, o.refinement, found.grid, plan.line_pitch_m, plan.sample_pitch_m);
}

// About what allocate() and the refinement take: asked for as a whole, so that nothing is taken in vain.
std::uint64_t DisplacementEstimator::Workspace::bytes() const {
  constexpr std::uint64_t kImages = 8, kPerImageNode = 54 + 9, kPerNode = 8;  // floats
  const auto image_nodes = static_cast<std::uint64_t>(found.grid.nodes());
  const std::uint64_t nodes = std::max<std::uint64_t>({plan.coarse.nodes(), plan.fine.nodes(), image_nodes});
  return plan.device_bytes() +
         sizeof(float) * (kImages * pad.total + kPerNode * nodes + kPerImageNode * image_nodes);
}

void DisplacementEstimator::require_fits(const RfFrame& frame, const AcquisitionGeometry& geometry,
                                         const DisplacementOptions& options) {
  Workspace(frame, geometry, options);
}

DisplacementEstimator::DisplacementEstimator(Queue queue, DisplacementOptions options)
    : queue_(std::move(queue)), options_(options), kernels_(std::make_unique<Kernels>(queue_)) {
  checked(options_.max_strain);
}

DisplacementEstimator::~DisplacementEstimator() = default;

void DisplacementEstimator::forget() {
  work_.reset();
}

void DisplacementEstimator::set_max_strain(double max_strain) {
  if (max_strain == options_.max_strain) return;
  options_.max_strain = checked(max_strain);
  work_.reset();
}

// One item per `run` samples of a line.
Range DisplacementEstimator::over_samples(int run) const {
  const auto runs = static_cast<std::size_t>((work_->plan.samples + run - 1) / run);
  return {{runs, static_cast<std::size_t>(work_->plan.lines), 1}, {16, 1, 1}};
}

// Levels 1 and 2: `field` on the fine grid.
void DisplacementEstimator::search() {
  Workspace& w = *work_;
  const SampleGrid &c = w.plan.coarse.grid, &g = w.plan.fine.grid;
  w.search->coarse(kernels_->search, w.pre_spans, w.frames.pre, w.frames.post, w.candidate);
  kernels_->smooth(over(c.nodes()), w.candidate, w.field, c.nx, c.ny);
  warp(c, false);
  kernels_->resample(over(g.nodes()), w.field, w.filtered, c, g);
  w.search->fine(kernels_->search, w.pre_spans, w.frames.pre, w.mean, w.filtered, w.candidate,
                 w.found.correlation);
  const auto threshold = static_cast<float>(kTrustedCorrelation - 0.2);
  kernels_->median_filter(over(g.nodes()), w.candidate, w.filtered, w.found.correlation, w.field, w.deviation,
                          g.nx, g.ny, 2, threshold, 0.5f, 0.15f * w.period);
  kernels_->smooth(over(g.nodes()), w.field, w.candidate, g.nx, g.ny);
  kernels_->smooth(over(g.nodes()), w.candidate, w.field, g.nx, g.ny);
}

// Level 3: `filtered`, `deviation` and what is found on the image grid from `field` on the fine grid.
void DisplacementEstimator::refine() {
  Workspace& w = *work_;
  DisplacementEstimate& found = w.found;
  const SampleGrid& g = found.grid;
  const auto threshold = static_cast<float>(kTrustedCorrelation);
  const auto tolerance = static_cast<float>(kOutlierDistanceM / w.plan.sample_pitch_m);
  kernels_->resample(over(g.nodes()), w.field, w.candidate, w.plan.fine.grid, g);
  std::swap(w.field, w.candidate);
  for (int n = 0; n < kRefinementSteps; ++n) {
    const bool last = n + 1 == kRefinementSteps;
    if (n > 0) std::swap(w.filtered, w.field);
    warp(g, true);
    const Autocorrelations a = w.refinement->measure(
        {w.mean, w.difference, w.pad.layout, w.plan.samples, w.plan.lines}, last, found.correlation);
    w.refinement->step(w.field, w.candidate, 1.0f, 0.25f * w.period, n);
    if (n + 2 == kRefinementSteps) filter_frames(a);
    kernels_->median_filter(over(g.nodes()), w.candidate, w.field, found.correlation, w.filtered, w.deviation,
                            g.nx, g.ny, 2, threshold, 0.25f, tolerance);
  }
  kernels_->report(over(g.nodes()), w.filtered, found.correlation, w.deviation, w.pre_inner, w.post_inner,
                   found.field_m, found.trusted, g, w.plan.lines, static_cast<float>(w.plan.line_pitch_m),
                   static_cast<float>(w.plan.sample_pitch_m), threshold, tolerance);
  const Refinement::Uncertainty said = w.refinement->uncertainty(w.filtered, found.information, found.std_m);
  found.noise = said.noise, found.unsolved = said.unsolved;
}

void DisplacementEstimator::warp(const SampleGrid& g, bool pair) {
  Workspace& w = *work_;
  const Workspace::Frames& frames = w.matched ? w.filtered_frames : w.frames;
  kernels_->warp(over_samples(kWarpRun), frames.pre, frames.post, w.pre_spans, w.post_spans, w.field, w.taps,
                 w.series, w.mean, w.difference, pair ? 1 : 0, kInterpolationPhases, w.plan.lines,
                 w.plan.samples, g, w.pad.layout);
}

void DisplacementEstimator::filter_frames(const Autocorrelations& a) {
  Workspace& w = *work_;
  const MatchedFilter filter = matched_filter(a, kFilterSamples, kFilterLines);
  const Array<float> axial = sent(queue_, filter.axial), lateral = sent(queue_, filter.lateral);
  Range range = over_samples(kFilterRun);
  range.global[2] = 2;
  // `mean` and `difference` are free between two steps.
  kernels_->filter_lines(range, w.frames.pre, w.frames.post, w.mean, w.difference, axial, kFilterSamples, 1,
                         w.plan.samples, w.pad.layout);
  kernels_->filter_lines(range, w.mean, w.difference, w.filtered_frames.pre, w.filtered_frames.post, lateral,
                         kFilterLines, w.pad.layout.stride, w.plan.samples, w.pad.layout);
  w.matched = true;
}

DisplacementEstimate DisplacementEstimator::estimate(const RfFrame& pre, const RfFrame& post,
                                                     const AcquisitionGeometry& geometry,
                                                     const Echoes& of_pre, int first) {
  if (work_ && !work_->serves(pre, geometry)) work_.reset();  // first: its room may be needed
  if (!work_) {
    auto work = std::make_unique<Workspace>(pre, geometry, options_);
    work->allocate(queue_, options_);
    work_ = std::move(work);
  }
  Workspace& w = *work_;
  const int end = still_from(pre, post, of_pre.step);  // of both frames
  const auto load = [&](const RfFrame& frame, std::vector<EchoSpan> lines,
                        std::shared_ptr<std::vector<float>>& host, Array<float>& image,
                        Array<EchoSpan>& spans, Array<EchoSpan>& inner) {
    for (EchoSpan& span : lines) {
      span.end = std::min(span.end, std::max(end, span.first));
      span.first = std::max(span.first, std::min(first, span.end));
    }
    if (host.use_count() != 1) grow(*(host = std::make_shared<std::vector<float>>()), w.pad.total);
    write_into(*host, frame, w.pad, lines);
    queue_.send(image, host);
    queue_.send(spans, lines);
    queue_.send(inner,
                away_from_silence(lines, w.plan.samples, half_width(2 * kEchoesLateralM, w.plan.line_pitch_m),
                                  half_width(2 * kEchoesAxialM, w.plan.sample_pitch_m)));
  };
  load(pre, of_pre.lines, w.host_pre, w.frames.pre, w.pre_spans, w.pre_inner);
  load(post, find_echoes(post, geometry).lines, w.host_post, w.frames.post, w.post_spans, w.post_inner);
  w.matched = false;
  search();
  check_cancelled();
  refine();
  return w.found;
}

}  // namespace teletact::service
