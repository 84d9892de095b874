// A window's displacement and strain, and whole windows, several at once.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <deque>

#include "bench/basics/median.h"
#include "bench/peers/rf_nodes.h"
#include "bench/phantoms/phantom.h"
#include "bench/suites/device/device.h"
#include "bench/windows_beside_touch.h"
#include "service/imaging/tracking/measured.h"

namespace teletact::bench {
namespace {

Works work_of(const Phantom& p) {
  const Nodes fine(p.pre, p.geometry, 1e-3, 1e-3), coarse(p.pre, p.geometry, 2e-3, 1e-3),
      image(p.pre, p.geometry, service::kGridDxM, service::kGridDyM);
  const double pixels = static_cast<double>(p.pre.samples.size()), nodes = image.grid.nodes();
  const auto window = coarse.window(service::kCoarseWindowAxialM, service::kCoarseWindowLateralM),
             search = fine.window(service::kFineWindowAxialM, service::kFineWindowLateralM);
  const double chunks =
      2 * std::ceil((service::DisplacementOptions{}.max_strain * p.tissue.depth_m / coarse.sample_m + 4) / 8);
  const double laterals = 2 * (std::lround(service::kLateralSearchM / 2 / fine.line_m) + 1) + 1;
  constexpr double kCoarseLaterals = 5, kReached = 0.7;  // means over the image; the rest is not looked at
  const double coarse_items = coarse.grid.nodes() * kCoarseLaterals * chunks * kReached,
               fine_items = fine.grid.nodes() * laterals;
  const auto samples_of = [](const reference::Window& w) {  // every second sample, every second line
    return (w.half_axial + 1.0) * (w.half_lateral + 1.0);
  };
  const double hat = std::ceil(image.grid.sample_step / 4.0) * (2 * image.grid.line_step - 1);
  const double kernel = 5 * 7;  // nodes of a strain kernel, about
  return {                      // the mean of the coarse and the fine launch
          {"ncc",
           {(4 * pixels * 4 + 32 * (coarse_items + fine_items)) / 2,
            16 * (coarse_items * samples_of(window) + fine_items * samples_of(search)) / 2}},
          {"warp", {16 * pixels, 120 * pixels}},
          {"filter_lines", {8 * pixels, 65 * pixels}},
          {"data_term", {8 * pixels, 300 * hat * nodes}},
          {"strain", {26 * nodes, 20 * kernel * nodes}},
          {"median_filter", {28 * nodes, 0}}};
}

// The middle lines of a phantom, 2078 samples each.
Phantom window(std::size_t lines) {
  Phantom p = Phantoms().make({}, 1);
  const std::size_t samples = p.pre.sample_count, first = (p.pre.line_count - lines) / 2 * samples;
  for (service::RfFrame* frame : {&p.pre, &p.post}) {
    const auto begin = frame->samples.begin() + std::ptrdiff_t(first);
    frame->samples = {begin, begin + std::ptrdiff_t(lines * samples)};
    frame->line_count = lines;
  }
  return p;
}

DeviceStage make(const std::shared_ptr<const Phantom>& p, bool with_strain,
                 const std::shared_ptr<service::Device>& device) {
  const service::Queue queue = device->queue();
  struct Estimators {
    explicit Estimators(const service::Queue& queue) : displacement(queue, {}), strain(queue, {}) {}
    service::DisplacementEstimator displacement;
    service::StrainEstimator strain;
  };
  const auto by = std::make_shared<Estimators>(queue);
  const std::string of = std::to_string(p->pre.sample_count) + " x " + std::to_string(p->pre.line_count);
  if (!with_strain)
    return {"displacement of " + of,
            queue,
            [=] { by->displacement.estimate(p->pre, p->post, p->geometry); },
            {},
            1,
            work_of(*p)};
  return {"displacement and strain of " + of + ", downloaded",
          queue,
          [=] {
            const service::DisplacementEstimate e = by->displacement.estimate(p->pre, p->post, p->geometry);
            service::Measured m;
            m.grid = service::image_grid(e.grid, p->geometry);
            service::download(queue, e, m);
            service::download(queue, by->strain.estimate(e, m.grid), m);
          },
          {},
          1,
          work_of(*p)};
}

}  // namespace

void measure_displacement(DevicePart& part) {
  const auto p = std::make_shared<const Phantom>(window(part.quick ? 32 : 128));
  for (const bool with_strain : {false, true})
    if (!with_strain || !part.quick)
      part.measure([&](const auto& device) { return make(p, with_strain, device); });
}

void measure_windows(DevicePart& part) {
  constexpr int kOfGpu = 31, kOfProcessor = 11, kQuick = 3;  // busy cores take a second a window
  constexpr std::array<std::size_t, 3> kAtOnceOfGpu{1, 4, 16}, kAtOnceOfProcessor{1, 2, 4};
  PhantomCase of;
  of.tissue_width_m = 0.160;
  const Phantom p = Phantoms().make(of, 1);
  const auto device = part.open();
  const auto& numbers = device->info().gpu ? kAtOnceOfGpu : kAtOnceOfProcessor;
  std::deque<service::Elastography> engines;
  while (engines.size() < (part.quick ? 1 : numbers.back())) engines.emplace_back(device);
  const int windows = part.quick ? kQuick : device->info().gpu ? kOfGpu : kOfProcessor;
  for (service::Elastography& engine : engines) engine.warm();
  for (const auto& [name, kind] : {std::pair{"direct", service::ModulusKind::kDirect},
                                   std::pair{"iterative", service::ModulusKind::kIterative}})
    for (const std::size_t at_once : numbers)
      for (const bool touch : {false, true}) {
        if (part.quick && (kind != service::ModulusKind::kDirect || at_once > 1)) continue;
        std::vector<std::function<service::Estimate()>> of_engines;
        for (std::size_t k = 0; k < at_once; ++k)
          of_engines.emplace_back([&, engine = &engines[k], kind = kind] {
            return engine->estimate(
                p.pre, p.post,
                {p.geometry, {{p.sensed_force_n, p.contact_area_m2}}, p.tissue, {}, {kind, {}}});
          });
        const WindowTimes t =
            windows_beside_touch(of_engines, windows, touch ? std::optional(scene_window()) : std::nullopt);
        const WindowsFigures f{name,
                               at_once,
                               touch,
                               t.windows_s,
                               1e3 * t.total_s.p50,
                               1e3 * t.total_s.p95,
                               1e3 * t.displacement_s.p50,
                               1e3 * t.strain_s.p50,
                               1e3 * t.modulus_s.p50,
                               touch ? 1e3 * t.touch_latency_s.p99 : kNan};
        part.add("windows", f);
        std::printf("windows, %s modulus, %zu at once%s: %.1f/s, p50 %.0f ms, p95 %.0f ms\n", name, at_once,
                    touch ? ", beside a touch stream" : "", f.windows_s, f.p50_ms, f.p95_ms);
        std::fflush(stdout);
      }
}

}  // namespace teletact::bench
