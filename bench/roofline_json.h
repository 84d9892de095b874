// The figures of roofline.h in JSON.
#pragma once

#include <nlohmann/json.hpp>

#include "bench/roofline.h"

namespace teletact::bench {

NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(DeviceFigures, name, driver_version, compute_units)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(KernelFigures, kernel, seconds, launches, bytes, flops, bound, of_limit)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(RunWork, launches, copies, waits, looks, bytes_to, bytes_from,
                                   longest_chain, model_s)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(KernelProfile, device, bytes_s, flops_s, kernels, work)

}  // namespace teletact::bench
