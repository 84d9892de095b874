// What a device can do at most, measured, and its kernels against that.
#pragma once

#include <map>
#include <nlohmann/json.hpp>
#include <string>

#include "service/device/device.h"

namespace teletact::bench {

struct Ceiling {
  double bytes_s = 0, flops_s = 0;
};
// By a triad and by chains of multiply-adds (kernels/roofline.cl), in float: arithmetic in double has half of
// it on processors.
Ceiling measure_ceiling(const service::Queue&);

// Of one launch, from the comments of the kernels; bytes: every array once.
struct Work {
  double bytes = 0, flops = 0;
};

// [{kernel, seconds, launches, bytes, flops, bound, of_limit}], the longest first, each for one of the `runs`
// that the queue has profiled; the last four where `work` has the kernel.
nlohmann::json kernels_of(const service::Queue&, const std::map<std::string, Work>& work, const Ceiling&,
                          int runs);

}  // namespace teletact::bench
