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

namespace teletact::service {

struct ElastographyOptions {
  DisplacementOptions displacement;
  StrainOptions strain;
};

struct ModulusChoice {
  std::optional<ModulusKind> kind = {};  // empty: as it is planned (modulus_plan.h)
  ModulusNeed need = {};
  // Asked once, when the strain is known. Empty: all.
  std::function<ModulusBudget()> budget = {};
};

enum class Stage { kDisplacement, kStrain, kModulus };

// Everything that is stated of a pair of frames.
struct EstimateInput {
  AcquisitionGeometry geometry;
  std::optional<ProbeForce> force;  // absent: relative modulus
  TissueExtent tissue;
  KnownModulus known = {};  // beside the window, from its neighbours, if there are any
  ModulusChoice modulus = {};
  std::vector<SliceBeside> beside = {};  // ModulusInput::beside
  std::vector<ToldBeside> told = {};     // ModulusInput::told
  bool b_mode = false;                   // Estimate::b_mode is wanted
  double sound_speed_deviation = 0;      // of its logarithm
};

// The measured pair and its modulus, filled stage by stage. A number of a node with valid = 0 is
// not to be used; the modulus is NaN exactly there.
struct Estimate : Measured {
  ModulusEstimate modulus;
  std::vector<std::uint8_t> valid;  // displacement, strain and modulus trusted
  double valid_fraction = 0;        // of the nodes
  BMode b_mode;                     // of the pre frame, where it was wanted
  // Frames that contradict what is stated of them; tracking that failed in part.
  std::vector<Warning> input_warnings;
  double displacement_s = 0, strain_s = 0, modulus_s = 0;
  std::shared_ptr<const Charge> held;  // of these maps
};

// Not thread-safe: one queue and its buffers, kept for the next pair.
class Elastography {
 public:
  // Throws DeviceError; std::invalid_argument for unusable options.
  Elastography(const std::shared_ptr<Device>&, ElastographyOptions = {});

  // Pairs are worked on in this name from now on, and what is kept of them for the next is held in it.
  void charge_to(const MemoryAccount&);
  const MemoryAccount& account() const { return queue_.account(); }
  // For the pairs to come; buffers that were set up for another are set up anew.
  void set_max_strain(double);
  // Compiles every kernel in every size that an estimate uses (a first launch costs tens of milliseconds).
  void warm();

  // `ended` is told each stage. Throws std::invalid_argument (field and remedy named), TrackingError.
  Estimate estimate(const RfFrame& pre, const RfFrame& post, const EstimateInput&,
                    const std::function<void(Stage)>& ended = {});

 private:
  void estimate_into(const RfFrame& pre, const RfFrame& post, const EstimateInput&,
                     const std::function<void(Stage)>& told, Estimate&);
  DisplacementEstimate track(const RfFrame& pre, const RfFrame& post, const EstimateInput&, Estimate&);
  void judge_tracking(const RfFrame& pre, const RfFrame& post, const AcquisitionGeometry&, Estimate&);
  ModulusEstimate find_modulus(ModulusInput, const ModulusChoice&);
  // The method, where none is named; `reference`: the modulus that was found on the way.
  ModulusPlan plan(const ModulusInput&, const ModulusChoice&, std::optional<ModulusEstimate>& reference);

  Queue queue_;
  std::shared_ptr<StripCache> strips_;
  DisplacementOptions search_;
  DisplacementEstimator displacement_;
  StrainEstimator strain_;
  BModeImager b_mode_;
  std::array<std::unique_ptr<ModulusMethod>, 4> modulus_;  // by ModulusKind
  std::unique_ptr<ModulusMethod> uncorrected_;             // reference stress, without corrections
};

}  // namespace teletact::service
