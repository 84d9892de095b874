// The parts of the suite of one device (device.cpp): what is run, measured and written.
#pragma once

#include <cstddef>
#include <functional>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "bench/basics/median.h"
#include "service/device/device.h"
#include "tests/reference/contact.h"

namespace teletact::bench {

// What the device can do at most; bytes of each array of the triad. In float.
struct DeviceLimits {
  double launch_s = 0, wait_s = 0, serial_term_s = 0;
  double triad_bytes = 0, triad_bytes_s = 0, flops_s = 0;
  double pinned_to_bytes_s = 0, pinned_from_bytes_s = 0, pageable_to_bytes_s = 0, pageable_from_bytes_s = 0;
};

// Of one launch, from the comments of the kernels; bytes: every array once.
struct Work {
  double bytes = 0, flops = 0;
};
using Works = std::map<std::string, Work>;

// What is timed: `run` without `less`, which holds `times` of it. Works on `queue` alone.
struct DeviceStage {
  std::string stage;
  service::Queue queue;
  std::function<void()> run, less = {};
  double times = 1;
  Works works = {};
};

// Of one of a stage; `ms` is NaN where a processor took a GPU's ways for its counts alone;
// `a_gpu_modelled_ms`, by GpuModel, where the kernels took them.
struct DeviceStageFigures {
  std::string stage;
  double ms = 0, launches = 0, copies = 0, waits = 0, looks = 0, mb_to = 0, mb_from = 0, longest_chain = 0,
         a_gpu_modelled_ms = 0;
};
// Of one run; what follows from its work is NaN and "" where nobody says how much that is.
struct KernelFigures {
  std::string stage, kernel;
  double launches = 0, ms = 0, gb_s = 0, gflop_s = 0, of_limit = 0;  // 1: at the limit
  std::string bound;
};

// Off from the double reference, and by how much it may be, both relative.
struct ReferenceFigures {
  std::string stage, precision;
  double off = 0, bound = 0;
  bool met = false;
};

struct WindowsFigures {
  std::string modulus;
  std::size_t at_once = 1;
  bool beside_touch = false;
  double windows_s = 0, p50_ms = 0, p95_ms = 0, displacement_ms = 0, strain_ms = 0, modulus_ms = 0,
         touch_p99_ms = 0;
};

struct TransformsFigures {
  std::string transform;
  double ours_ms = 0, vkfft_ms = kNan, vkfft_off = kNan;
  std::string absent = {};  // why VkFFT took no part
};

NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(DeviceLimits, launch_s, wait_s, serial_term_s, triad_bytes, triad_bytes_s,
                                   flops_s, pinned_to_bytes_s, pinned_from_bytes_s, pageable_to_bytes_s,
                                   pageable_from_bytes_s)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(DeviceStageFigures, stage, ms, launches, copies, waits, looks, mb_to,
                                   mb_from, longest_chain, a_gpu_modelled_ms)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(KernelFigures, stage, kernel, launches, ms, gb_s, gflop_s, of_limit, bound)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(ReferenceFigures, stage, precision, off, bound, met)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(TransformsFigures, transform, ours_ms, vkfft_ms, vkfft_off, absent)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(WindowsFigures, modulus, at_once, beside_touch, windows_s, p50_ms, p95_ms,
                                   displacement_ms, strain_ms, modulus_ms, touch_p99_ms)

// A part at work: what it measures on, and where each row goes as soon as it is known.
class DevicePart {
 public:
  using Device = std::shared_ptr<service::Device>;
  virtual ~DevicePart() = default;
  const service::DeviceOptions options;  // of the device
  const bool quick;
  DeviceLimits limits;  // zeros where they are not known
  Device open() const;
  virtual void add(const char* table, const nlohmann::json& row) = 0;
  // Times it, counts what it asks for, and profiles its kernels. On a processor counts again with a GPU's
  // ways.
  void measure(const std::function<DeviceStage(const Device&)>& make);

 protected:
  DevicePart(service::DeviceOptions of, bool is_quick) : options(std::move(of)), quick(is_quick) {}

 private:
  void add_stage(service::DeviceOptions, const std::string& name, double seconds,
                 const std::function<DeviceStage(const Device&)>& make);
};

// Of a scene: 60 mm within tissue 260 mm wide and 40 mm deep, of contrast 10.
reference::TouchedTissue scene_window();
// [count][dof]: 1 N/m on nodes of the surface, each its own.
std::vector<double> surface_loads(const service::TissueGrid&, std::size_t count);

DeviceLimits measure_limits(const service::DeviceOptions&, bool quick);
void measure_displacement(DevicePart&);
void measure_solids(DevicePart&);
void measure_planes(DevicePart&);
void measure_references(DevicePart&);
void measure_windows(DevicePart&);
void measure_transforms(DevicePart&);

}  // namespace teletact::bench
