// How far a modulus map can be trusted (T3.4): the standard deviation of log E, and what makes it doubtful.
#pragma once

#include <memory>

#include "service/imaging/modulus/modulus.h"
#include "service/imaging/modulus/strip_model.h"

namespace teletact::service {

struct JudgeLimits {
  double untracked = 0.10;  // part of the image inside the tissue
  double deviation = 0.25;  // median standard deviation of log E
  double extent = 0.14;     // part of the window that is no background, beyond what inclusions of 15 mm show
  double ramp = 1.25;       // of the background's modulus from one end of the window to the other
  double lateral_ratio = 0.25;  // of - eps_xx / eps_yy, from what the plane assumption says
  double pressure = 0.10;       // of log E when nu is off by 0.01, which is how well tissue's is known
  // Median difference of log E from what other windows told, in deviations of both together.
  double disagreement = 3;
};

// Of a sum of errors of log E, variance `own` of correlation length `length_m` and `common`, alike all
// around: the length in m with which it correlates as it does at the distance of what a fingertip feels.
double correlation_with_common(double length_m, double own, double common);

// Adds to `out`, whatever the method: log_deviation (the method's posterior, else the noise of the axial
// strain and a floor; what a jump of the modulus is smeared over and what is lost of its contrast), the
// length that it correlates over, and the flags kNoise, kUntracked, kRamp, kOutOfPlane, kPressure, kScale,
// kExtent with their words. The last three widen the deviation by what they found, and so does a solid's
// kMisfit.
class ModulusJudge {
 public:
  explicit ModulusJudge(std::shared_ptr<StripCache>, JudgeLimits = {}, SlopeReach = {});
  void judge(const ModulusInput&, ModulusEstimate& out) const;

 private:
  // The mean square of what correlates as the method says; the rest is alike all around.
  double deviation(const ModulusInput&, ModulusEstimate&) const;
  void untracked(const ModulusInput&, ModulusEstimate&) const;
  void ramp(const ModulusInput&, ModulusEstimate&) const;
  void out_of_plane(const ModulusInput&, ModulusEstimate&) const;
  void pressure(const ModulusInput&, ModulusEstimate&) const;
  void scale(const ModulusInput&, ModulusEstimate&) const;
  void extent(const ModulusInput&, ModulusEstimate&) const;
  void misfit(ModulusEstimate&) const;
  std::shared_ptr<StripCache> strips_;
  JudgeLimits limits_;
  SlopeReach reach_;
};

}  // namespace teletact::service
