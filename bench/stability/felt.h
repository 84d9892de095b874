// What stiffness an observer feels who draws a finger over an inclusion, at the end of the whole chain: late
// and few answers, renderer, safety chain, a device's resolution.
#pragma once

#include <string>
#include <vector>

namespace teletact::bench {

struct FeltOptions {
  std::string renderer = "kalman";  // law: its columns 1 mm apart, told before the finger comes
  double update_s = 0.01;           // between answers
  double model_delay_s = 0.005;     // from a pose to its answer
  double resolution_m = 3e-5;
  double speed_m_s = 0.12;
  double indentation_m = 0.002;  // in the mean; it sways by a tenth of it
  double edge_m = 0.0015;        // of the inclusion: logistic, 4.4 times this from 10 to 90 %
};

// The inclusion is 20 mm wide with soft edges. Felt is force over indentation, averaged over 10 mm where that
// differs most from the background: a person judges what was felt, not where. Over the same of the background
// before it, times the background. One value per pass; passes differ in when answers happen to come and how
// the finger sways.
std::vector<double> felt_stiffness(const FeltOptions&, double background_n_m, double stimulus_n_m,
                                   unsigned passes);

}  // namespace teletact::bench
