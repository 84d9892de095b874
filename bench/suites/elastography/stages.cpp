// The time of the imaging plane while a finger is answered beside it, and for every OpenCL
// device the time of every kernel with the bytes that it must move and the flops that it does, against what
// the device can.
#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <map>
#include <thread>

#include "bench/basics/clock.h"
#include "bench/peers/contact_case.h"
#include "bench/peers/rf_nodes.h"
#include "bench/suites/elastography/elastography.h"
#include "service/contact/contact.h"
#include "service/imaging/estimate.h"
#include "service/tissue/tissue_model.h"

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

KernelProfile measure_device(const service::DeviceInfo& info, const Phantom& p, bool quick) {
  const ProfiledDevice profiled(info.index);
  const service::Queue queue = profiled.device()->queue();
  service::DisplacementEstimator displacement(queue, {});
  service::StrainEstimator strain(queue, {});
  const int pairs = quick ? 2 : 10;
  queue.take_work();
  for (int k = 0; k < pairs; ++k) {
    const service::DisplacementEstimate e = displacement.estimate(p.pre, p.post, p.geometry);
    strain.estimate(e, service::image_grid(e.grid, p.geometry));
    queue.finish();
  }
  return profiled.profile(queue, work_of(p), pairs);
}

// A finger that slides over a condensed surface and is answered kRateHz times a second, on a thread of its
// own.
class Finger {
 public:
  Finger() : tissue_(make_tissue({})), model_(tissue_.grid, tissue_.material, tissue_.supports, {}) {
    compliance_ = model_.compliance(0);
    thread_ = std::thread([this] { slide(); });
  }
  ~Finger() { stop(); }
  // Seconds from when an answer was due to when it was there.
  const std::vector<double>& stop() {
    stopped_ = true;
    if (thread_.joinable()) thread_.join();
    return latency_s_;
  }

 private:
  static constexpr double kRateHz = 500;
  void slide() {
    const auto begin = Clock::now();
    for (int k = 0; !stopped_; ++k) {
      const auto due =
          begin + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(k / kRateHz));
      std::this_thread::sleep_until(due);
      const double x_m = 0.030 + 0.010 * std::sin(0.012 * k);
      service::solve_contact(model_.problem(), 0, *compliance_, {}, {x_m, 0.002});
      latency_s_.push_back(seconds_since(due));
    }
  }
  reference::TouchedTissue tissue_;
  service::TissueModel model_;
  std::shared_ptr<service::Compliance> compliance_;
  std::atomic<bool> stopped_{false};
  std::vector<double> latency_s_;
  std::thread thread_;
};

PlaneTimes measure_plane(service::Elastography& elastography, service::ModulusKind kind, const Phantom& p,
                         bool quick) {
  const service::ProbeForce force{p.sensed_force_n, p.contact_area_m2};
  std::vector<double> displacement, strain, modulus, total;
  Finger finger;
  for (int k = 0; k < (quick ? 5 : 31); ++k) {
    const auto begin = Clock::now();
    const service::Estimate e =
        elastography.estimate(p.pre, p.post, {p.geometry, force, p.tissue, {}, {kind, {}}});
    total.push_back(seconds_since(begin));
    displacement.push_back(e.displacement_s), strain.push_back(e.strain_s), modulus.push_back(e.modulus_s);
  }
  return {quantiles(displacement), quantiles(strain), quantiles(modulus), quantiles(total),
          quantiles(finger.stop())};
}

}  // namespace

StageFigures measure_stages(const std::shared_ptr<service::Device>& device, bool quick) {
  PhantomCase c;
  c.tissue_width_m = 0.160;
  const Phantom p = Phantoms().make(c, 1);
  service::Elastography elastography(device);
  elastography.warm();
  StageFigures out{measure_plane(elastography, service::ModulusKind::kDirect, p, quick),
                   measure_plane(elastography, service::ModulusKind::kIterative, p, quick),
                   {}};
  for (const service::DeviceInfo& info : service::list_devices())
    out.devices.push_back(measure_device(info, p, quick));
  return out;
}

}  // namespace teletact::bench
