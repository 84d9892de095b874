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
#include "service/contact/layer_touch.h"
#include "service/contact/solid_contact.h"
#include "service/device/device.h"
#include "service/solid/felt_modulus.h"

namespace teletact::bench {

// Of one model at one pose.
struct PlanAnswer {
  std::string model;
  double spacing_m = 0;  // of its nodes; 0: it has none
  double force_n = 0;    // axial
  double ms = 0;         // of the processor, all threads, without what a scene is made ready with
  double stated = 0;     // that the force may be off by, over itself; 0: it states nothing
};

// M0: the closed form, of the modulus that is felt in the mean, and of the one felt at the place (T8.4's
// shares). M2: the layered contact. G: T8.4's guess. M3 k: the solid on nodes 2 mm apart, k iterations of one
// correction; M3: until the product is content; M3 near: answered by a correction 1 mm away. G 1 mm, M4: on
// nodes 1 mm apart. plane: of the slice under the tip in plane strain (a rigid tip, converged), so thick that
// homogeneous tissue would answer as its layer does. extruded: M3 of that slice extruded.
class PlanModels {
 public:
  explicit PlanModels(const std::shared_ptr<service::Device>& device) : queue_(device->queue()) {}
  // Made ready for this one; it must outlive the next at().
  void enter(const PlanScene&);
  std::vector<PlanAnswer> at(const PlanPose&);
  // What the converged contact on the nodes of M3 answers, in double, and on those of M4 at the last at().
  double converged_n(const PlanPose&);
  double fine_converged_n() const { return fine_converged_n_; }
  // The exact layer of the scene's mean modulus, and how much of it the nodes of M3 answer: the mesh's share.
  double layer_n(const PlanPose&) const;
  double mesh_share(const PlanPose&) const;

 private:
  using Contact = service::SolidContact<float>;
  // Homogeneous tissue of the same size, whatever its modulus.
  struct Layer {
    service::LayerTouch touch;
    Contact nodes;
    service::EnergyShares shares;
    std::unique_ptr<RigidContact> plane;
  };
  Layer& layer_of(const PlanScene&);
  void answer_of_slice(const PlanPose&, std::vector<PlanAnswer>&);
  // Models of the contact on one grid; returns what they converge to, in float.
  double answer_on(const Contact& felt, const PlanPose&, const char* guess, const std::string& corrected,
                   const std::vector<std::size_t>& iterations, std::vector<PlanAnswer>&) const;
  service::Vector3 in_block(const PlanPose&) const;
  double felt_pa(const PlanPose&) const;
  service::Queue queue_;
  std::map<std::tuple<double, double, std::size_t>, std::unique_ptr<Layer>> layers_;
  const PlanScene* scene_ = nullptr;
  Layer* layer_ = nullptr;
  Eigen::VectorXd felt_ln_;  // ln of the modulus that is felt at each node, Pa
  double mean_pa_ = 0, fine_converged_n_ = 0;
  std::optional<Contact> layered_, coarse_, fine_;
  std::optional<service::SolidContact<double>> exact_;
};

}  // namespace teletact::bench
