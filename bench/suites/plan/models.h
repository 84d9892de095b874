// The models of the plan chart: each answers a touch of a scene, and is timed.
#pragma once

#include <cstddef>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <tuple>
#include <vector>

#include "bench/rigid_contact.h"
#include "bench/suites/plan/scenes.h"
#include "service/contact/layered_touch.h"
#include "service/contact/shares_touch.h"
#include "service/contact/solid_contact.h"
#include "service/device/device.h"

namespace teletact::bench {

// Of one model at one pose.
struct PlanAnswer {
  std::string model;
  double force_n = 0;      // axial
  double ms = 0;           // of the processor, all threads, without what a scene is made ready with
  double stated = 0;       // that the force may be off by, over itself; 0: it states nothing
  double converged_n = 0;  // in double: of the solid on the model's nodes, or on those of M3
  // Half width of its budget (T9.4) without finite strain: tissue is linear here. 0: it states none.
  double budget = 0;
  std::string by{};  // which model answered, where a planner chose
};

// What the planner is asked for: shares of the force; and newtons, as the usual 5 mN are to 3 %.
inline constexpr double kPlanTolerances[] = {0.01, 0.03, 0.05, 0.1}, kPlanFloor = 0.005 / 0.03;

// M0: the exact homogeneous layer (T9.0) of the modulus half-way between the least and the most that is felt
// anywhere; M2: the exact layers (T9.1); M1: the product's log-weighted shares of the force (T9.2). G: T8.4's
// guess. M3 k: the solid on nodes 2 mm apart, k iterations of one correction; M3: until the product is
// content; M3 near: answered by a correction 1 mm away. M4: the same on nodes 1 mm apart. plane: of the slice
// under the tip in plane strain (a rigid tip, converged), so thick that homogeneous tissue would answer as
// its layer does. extruded: M3 of that slice extruded. "nodes": without T9.3, so off by what the mesh is off
// by. planned: M1 or M3, as the product's planner takes them at a tolerance.
class PlanModels {
 public:
  // `offered`: M0, M2, M1, M3 and what is planned alone, not those that they are compared with.
  explicit PlanModels(const std::shared_ptr<service::Device>& device, bool offered)
      : queue_(device->queue()), offered_(offered) {}
  // What is learned before shares are known, of the processor, ms: the fields of a factor, the shares
  // of another slice, a tip's tables.
  struct Learned {
    double fields_ms = 0, slice_ms = 0, tip_ms = 0;
  };
  // What a scene takes to be made ready with the nodes of one grid, ms, and what it learns on them.
  struct Ready {
    double m3_ms = 0, m4_ms = 0;
    Learned coarse{}, fine{};  // 2 and 1 mm
  };
  // Made ready for this one; it must outlive the next at(). `learn_fine`: what is learned on nodes 1 mm apart
  // is timed, too.
  Ready enter(const PlanScene&, bool learn_fine);
  std::vector<PlanAnswer> at(const PlanPose&);
  // The exact layer of M0's modulus.
  double layer_n(const PlanPose&) const;

 private:
  using Contact = service::SolidContact<float>;
  // Homogeneous tissue of the same size, whatever its modulus.
  struct Layer {
    service::LayeredTouch touch;  // of 1 Pa
    std::unique_ptr<RigidContact> plane;
  };
  Layer& layer_of(const PlanScene&);
  Learned learned(Contact&) const;
  void answer_of_slice(const PlanPose&, double converged_n, std::vector<PlanAnswer>&);
  // Models of the contact on one grid; `name`: that of the corrected ones.
  void answer_on(const Contact& felt, double converged_n, const PlanPose&, const std::string& name,
                 const char* guess, const std::vector<std::size_t>& iterations,
                 std::vector<PlanAnswer>&) const;
  void answer_by(const Contact&, double converged_n, const PlanPose&, const std::string& model,
                 double before_ms, std::vector<PlanAnswer>&) const;
  // Until the product is content.
  void answer_corrected(const Contact& felt, double converged_n, const PlanPose&, const std::string& name,
                        std::vector<PlanAnswer>&) const;
  double felt_modulus_pa() const;                            // half-way
  double exact_n(const PlanPose&, double modulus_pa) const;  // of a homogeneous layer
  service::Vector3 in_block(const PlanPose&) const;
  void answer_planned(double converged_n, const PlanPose&, std::vector<PlanAnswer>&) const;
  service::Queue queue_;
  const bool offered_;
  std::map<std::tuple<double, double, std::size_t>, std::unique_ptr<Layer>> layers_;
  const PlanScene* scene_ = nullptr;
  Layer* layer_ = nullptr;
  double layer_pa_ = 0;                                // of M0
  std::optional<service::LayeredTouch> layers_touch_;  // M2
  std::shared_ptr<const service::SharesTouch> shares_;
  std::optional<Contact> coarse_, fine_;
  std::optional<service::SolidContact<double>> exact_, fine_exact_;
};

}  // namespace teletact::bench
