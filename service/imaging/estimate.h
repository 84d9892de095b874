// The imaging plane in one call: RF pair -> displacement -> strain -> Young's modulus.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "service/base/choices.h"
#include "service/device/device.h"
#include "service/imaging/modulus/judge.h"
#include "service/imaging/modulus/modulus.h"
#include "service/imaging/modulus/modulus_plan.h"
#include "service/imaging/modulus/strip_model.h"
#include "service/imaging/modulus/tissue_extent.h"
#include "service/imaging/tracking/b_mode.h"
#include "service/imaging/tracking/displacement.h"
#include "service/imaging/tracking/frame.h"
#include "service/imaging/tracking/measured.h"
#include "service/imaging/tracking/strain.h"

namespace teletact::service {

struct ElastographyOptions {
  DisplacementOptions displacement;
  StrainOptions strain;
  ReferenceStressOptions reference_stress;
  DirectOptions direct;
  IterativeOptions iterative;
  SolidModulusOptions solid;
  double min_median_correlation = choices::kMinMedianCorrelation;
};

// How the modulus is to be found.
struct ModulusChoice {
  std::optional<ModulusKind> kind = {};     // empty: as it is planned (modulus_plan.h)
  std::optional<double> time_limit_s = {};  // for the modulus alone, > 0; empty: what `time` leaves
  ModulusNeed need = {};
  // Asked when the strain is known and between the steps of an iteration: it may leave less by then. Empty:
  // nobody waits.
  std::function<ModulusTime()> time = {};
};

enum class Stage { kDisplacement, kStrain, kModulus };

// `cancelled` said so.
struct EstimateCancelled : std::runtime_error {
  EstimateCancelled() : std::runtime_error("the estimate was cancelled") {}
};

// What is known of a pair of frames.
struct EstimateInput {
  AcquisitionGeometry geometry;
  std::optional<ProbeForce> force;  // absent: relative modulus
  TissueExtent tissue;
  KnownModulus known = {};  // beside the window, from its neighbours, if there are any
  ModulusChoice modulus = {};
  std::vector<SliceBeside> beside = {};  // ModulusInput::beside
  bool b_mode = false;                   // Estimate::b_mode is wanted
};

// Who follows an estimate.
struct EstimateObserver {
  std::function<void(Stage)> progress = {};  // called when a stage has ended
  std::function<bool()> cancelled = {};      // asked at every look (service/device/cancellation.h)
};

// What was measured of the pair, and its modulus: filled stage by stage. A number of a node with valid = 0 is
// not to be used; the modulus is NaN exactly there.
struct Estimate : Measured {
  ModulusEstimate modulus;
  std::vector<std::uint8_t> valid;  // displacement, strain and modulus trusted
  double valid_fraction = 0;        // of the nodes
  BMode b_mode;                     // of the pre frame, where it was wanted
  // Frames that contradict what is stated of them; tracking that failed in part.
  std::vector<std::string> input_warnings;
  double displacement_s = 0, strain_s = 0, modulus_s = 0;
  std::shared_ptr<const Charge> held;  // of these maps
};

// Not thread-safe: one queue and its buffers, kept for the next pair.
class Elastography {
 public:
  // Throws DeviceError; std::invalid_argument for unusable options.
  Elastography(const std::shared_ptr<Device>&, ElastographyOptions = {});

  // In whose name pairs are worked on from now on: what is kept of them for the next, too.
  void charge_to(const MemoryAccount&);
  const MemoryAccount& account() const { return queue_.account(); }
  // Of the pairs to come; what was set up for another is set up anew.
  void set_max_strain(double);
  // Compiles every kernel in every size that an estimate uses (a first launch costs tens of milliseconds).
  void warm();

  // Throws std::invalid_argument (field and remedy named), TrackingError, EstimateCancelled.
  Estimate estimate(const RfFrame& pre, const RfFrame& post, const EstimateInput&,
                    const EstimateObserver& = {});

 private:
  DisplacementEstimate track(const RfFrame& pre, const RfFrame& post, const AcquisitionGeometry&, Estimate&);
  void judge_tracking(const RfFrame& pre, const RfFrame& post, const AcquisitionGeometry&, Estimate&);
  void find_modulus(ModulusInput, const ModulusChoice&, Estimate&);
  // Which method, where none is named; `reference`: what was found on the way.
  ModulusPlan plan(const ModulusInput&, const ModulusChoice&, const ModulusTime&,
                   std::optional<ModulusEstimate>& reference);

  Queue queue_;
  std::shared_ptr<StripCache> strips_;
  ElastographyOptions options_;
  DisplacementEstimator displacement_;
  StrainEstimator strain_;
  BModeImager b_mode_;
  std::array<std::unique_ptr<ModulusMethod>, 4> modulus_;  // by ModulusKind
  std::unique_ptr<ModulusMethod> uncorrected_;             // reference stress, without corrections
  std::unique_ptr<ModulusJudge> judge_;
};

}  // namespace teletact::service
