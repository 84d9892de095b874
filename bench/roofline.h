// What a device can do at most, measured, and its kernels against that.
#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "service/device/device.h"

namespace teletact::bench {

struct DeviceFigures {
  std::string name, driver_version;
  std::size_t compute_units = 0;
};
DeviceFigures describe(const service::DeviceInfo&);

// Of one launch, from the comments of the kernels; bytes: every array once.
struct Work {
  double bytes = 0, flops = 0;
};
using Works = std::map<std::string, Work>;

// Of one run; bytes and what follows are NaN and "" where nobody says how much work a kernel has.
struct KernelFigures {
  std::string kernel;
  double seconds = 0, launches = 0, bytes = 0, flops = 0;
  std::string bound;
  double of_limit = 0;  // 1: at the limit
};

// Of one run, what its queue asked for (service::DeviceWork), and how long a GPU would take by the model of
// roofline.cpp: no measurement.
struct RunWork {
  double launches = 0, copies = 0, waits = 0, looks = 0, bytes_to = 0, bytes_from = 0;
  double longest_chain = 0;
  double model_s = 0;
};

// The longest kernels first.
struct KernelProfile {
  std::string device;
  double bytes_s = 0, flops_s = 0;  // at most: float; arithmetic in double has half of it on processors
  std::vector<KernelFigures> kernels;
  RunWork work{};
};
void print(const KernelProfile&);

// A device whose ceiling was measured, by a triad and by chains of multiply-adds (bench/kernels/roofline.cl),
// opened again with profiling.
class ProfiledDevice {
 public:
  explicit ProfiledDevice(std::size_t index);
  const std::shared_ptr<service::Device>& device() const { return device_; }
  // Of what `queue` has done in `runs`, each; its work since the last take_work().
  KernelProfile profile(const service::Queue& queue, const Works& work, int runs) const;

 private:
  double bytes_s_ = 0, flops_s_ = 0;
  std::shared_ptr<service::Device> device_;
};

}  // namespace teletact::bench
