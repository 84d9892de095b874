#include "tests/vectors/recorder/product.h"
#include "tests/vectors/recorder/record.h"

namespace teletact::vectors {
namespace {

std::vector<PatientCase> patients() {
  return {{"soft-inclusion", R"(seed = 11
[tissue]
width_m = 0.06
[[inclusion]]
position_m = [0.030, 0.015]
diameter_m = 0.012
contrast = 3
[probe]
compression_strain = 0.01
)",
           0},
          {"two-stiff-inclusions", R"(seed = 12
[tissue]
width_m = 0.10
youngs_modulus_pa = 20e3
[[inclusion]]
position_m = [0.040, 0.012]
diameter_m = 0.010
contrast = 8
[[inclusion]]
position_m = [0.065, 0.020]
diameter_m = 0.014
contrast = 5
[probe]
compression_strain = 0.02
)",
           0.02, false, true, true},
          {"deep-and-relative", R"(seed = 13
[tissue]
width_m = 0.08
depth_m = 0.05
poisson_ratio = 0.495
[[inclusion]]
position_m = [0.035, 0.018]
diameter_m = 0.010
contrast = 4
[probe]
width_m = 0.04
lines = 128
compression_strain = 0.005
)",
           0.02, true, false, false}};
}

}  // namespace

void record_estimates(Recording& recording) {
  for (const PatientCase& patient : patients())
    for (const Estimated& estimated : estimate(patient))
      for (const Named& map : estimated.maps)
        recording.append("estimate/" + patient.name + "/" + estimated.by + "/" + map.name, 1, map.values,
                         map.exact                    ? kExact
                         : estimated.by == "tracking" ? kMap
                                                      : kModulus);
}

}  // namespace teletact::vectors
