// How far a modulus map can be trusted (T3.4): the standard deviation of log E, and what makes it doubtful.
#pragma once

#include "service/imaging/modulus/modulus.h"
#include "service/imaging/modulus/strip_model.h"

namespace teletact::service {

// A sum of errors of log E, variance `own` of correlation length `length_m` and `common`, alike all around,
// correlates as it does at the distance that a fingertip feels with this length in m.
double correlation_with_common(double length_m, double own, double common);

// Warns that no tissue explains the strain (kMisfit) where ln E that has not settled has no background: half
// of it lies beyond a factor of two, `spread` being its deviation by that half, and more than `noise` brings.
void no_background(double spread, double noise, ModulusEstimate& out);

// Adds to `out`, whatever the method: log_deviation (the method's posterior, else the noise of the axial
// strain and a floor; what a jump of the modulus is smeared over and what is lost of its contrast), the
// length that it correlates over, and the flags kUntracked, kRamp, kOutOfPlane, kPressure, kScale, kExtent
// with their words. The last two widen the deviation by what they found, and so does a solid's kMisfit.
// Where the median deviation is then above a quarter, whatever it is made of most says so: kNoise, kModels,
// kUnstated, or what has warned before, each with this median.
void judge(const ModulusInput&, StripCache&, ModulusEstimate& out);

}  // namespace teletact::service
