// Contact of a rigid fingertip with the surface of solid tissue, or with a row of nodes below it (T4.3 to
// T4.5b on a surface, T8.4).
#pragma once

#include <atomic>
#include <deque>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <utility>
#include <vector>

#include "service/base/choices.h"
#include "service/contact/layered_touch.h"
#include "service/contact/shares_touch.h"
#include "service/contact/touch_model.h"
#include "service/tissue/solid/element_shares.h"
#include "service/tissue/solid/recycled_compliance.h"
#include "service/tissue/solid/solid_solver.h"

namespace teletact::service {

// Why an answer is off by more than was asked: no correction would make it better.
inline constexpr const char* kRoundingReason = "rounding";

struct SolidContactOptions {
  double force_error = choices::kSolidForceError;  // over the force: the contact is corrected until below it
  std::size_t max_corrections = choices::kMaxCorrections;
};

// How a tissue's layers have left those of the factor that it is solved with (T8.7): as one, by which S0 is
// scaled, and in ln E0 beside that, at most.
struct LayersDrift {
  double scale = 1, shape = 0;
};
LayersDrift drift_between(const LayeredTissue& factor, const LayeredTissue& own);

// A block of tissue that is touched on its surface, or on a row of nodes below it.
//
// The contact is solved on the recycled compliance S' (recycled_compliance.h). Where that may put the force
// off by more than is asked, the whole block is solved under the contact that was found (SolidSolver::push).
// S' is then exact for its forces, and the contact is solved again. S' is never changed but replaced: answers
// go on from the one before while the next is learned.
template <class T>
class SolidContact {
 public:
  // Throws as SolidSolver does.
  SolidContact(const Queue&, const SolidTissue&);
  // Another modulus of the same grid and Poisson ratio, soon (T8.7): it shares what the other solves with, so
  // both together are corrected by one thread at a time. Making it is none of that, and takes a queue of its
  // own. What the other has learned is of its modulus, and stays there; how this one's is felt is found with
  // its first correction.
  SolidContact(const Queue&, const SolidContact& before, const SolidTissue&);
  // The same tissue on a row of nodes, another or the same: it shares and takes as the one above, learns on
  // its own, and takes nothing of the device before its first correction.
  SolidContact(const SolidContact& same, std::size_t row);
  SolidContact(const SolidContact&) = delete;  // its parts refer to each other
  SolidContact& operator=(const SolidContact&) = delete;
  // Finds how its modulus is felt, once: answers before that take all tissue for layered. One thread at a
  // time.
  void feel();
  // Finds how forces on its surface follow from its modulus alone, once: shares() is null before that. By any
  // thread, beside the others; on this queue, and with the solver, which it locks for each of its solutions.
  void learn_shares(const Queue&, std::mutex& solving);
  bool has_learned() const;
  // The same touch without nodes; null where no shares are known: of other tips, below the surface. By any
  // thread; the first of a tip takes some ms.
  std::shared_ptr<const SharesTouch> shares(const Fingertip&) const;
  // What is known by now, by any thread beside the others.
  // Pose: [x, indentation, z], x and z in the block's coordinates, the indentation from the undeformed row.
  // U(pose) = max over p_y >= 0, p_x, p_z of p.w(pose) - p.(S + C(pose)) p / 2 + W(p_y, pose), as in
  // solve_contact (contact.h); frictionless: p_y alone. Rounded tip: w = indentation - r^2 / (2 radius), r
  // from its axis; flat punch: a disc of radius half_width, r beyond its rim; pad: such a disc that gives way
  // node by node, C on S's diagonal. Node: as touch_node has it. Throws as solve_contact does.
  ContactAnswer answer(const Fingertip&, const Vector3& pose,
                       double force_error = choices::kSolidForceError) const;
  // The same with its layered part exact instead of on nodes (make_layers_exact): of frictionless round tips
  // on the surface, as deep as LayeredTouch knows; else as answer(). Of round tips with its budget.
  ContactAnswer felt_answer(const Fingertip& tip, const Vector3& pose,
                            double force_error = choices::kSolidForceError) const;
  // Solves the block under the contact at this pose, to what that force error takes; answers after it know
  // what it showed. One thread at a time; after `max_iterations` of conjugate gradients it takes what there
  // is. Throws as answer() does, std::domain_error where the block's solution breaks down.
  SolveReport correct(const Fingertip&, const Vector3& pose, double force_error = choices::kSolidForceError,
                      std::size_t max_iterations = SolidOptions{}.max_iterations);
  // Answers, corrected before as long as that helps.
  ContactAnswer touch(const Fingertip&, const Vector3& pose, const SolidContactOptions& = {});
  // What bears `force_n` in all (to 1e-6 of it) of the layered tissue alone under the same tip, at the same x
  // and z. By any thread, beside the others. Throws as touch() does, std::domain_error where no depth does.
  std::vector<NodalPressure> layered_pressure(const Fingertip&, const Vector3& pose, double force_n) const;
  // How far these nodes of the row (i + nx k) move along y under the tip, m, by what is known by now. By any
  // thread, beside the others. Throws as touch().
  Eigen::VectorXd moved_m(const Fingertip&, const Vector3& pose, const std::vector<std::size_t>& nodes) const;
  const SolidTissue& tissue() const { return tissue_; }
  std::size_t row() const { return row_->solved->index; }
  const LayersDrift& drift() const { return drift_; }
  std::size_t corrections() const { return corrections_; }  // contacts solved on the whole block, in all

 private:
  // A row of nodes of a factor: shared by all contacts with it.
  struct Row {
    Row(std::shared_ptr<const SolidRow> solved, SurfaceCompliance wide, SurfaceCompliance smooth)
        : solved(std::move(solved)), wide(std::move(wide)), smooth(std::move(smooth)) {}
    std::shared_ptr<const SolidRow> solved;
    SurfaceCompliance wide, smooth;
    std::optional<EnergyShares> shares;  // of who corrects
    std::mutex learning;                 // of the shares of forces on the surface
    std::optional<ForceShares> force_shares;
  };
  // Shared by all contacts whose modulus it solves.
  struct Factor {
    Factor(const Queue&, const SolidTissue&);
    std::shared_ptr<Row> row(const SolidGrid&, const LayeredTissue&, double poisson_ratio, std::size_t);
    Queue queue;
    SolidSolver<T> solver;
    const std::shared_ptr<const SolidRow> surface;
    std::mutex mutex;
    std::map<std::size_t, std::weak_ptr<Row>> rows;  // under the mutex
    // Of the layers under the tips touched last, under this mutex: answers wait for no row that is being
    // made.
    std::mutex exact_mutex;
    std::deque<std::pair<Fingertip, std::shared_ptr<const LayeredTouch>>> exact;
  };
  SolidContact(const SolidTissue&, std::shared_ptr<Factor>, std::shared_ptr<const SolidModulus<T>>,
               std::size_t row);
  using Known = std::shared_ptr<const RecycledCompliance>;
  Known known(const Fingertip&) const;
  ContactAnswer answer_by(const RecycledCompliance&, const Fingertip&, const Vector3& pose,
                          double force_error) const;
  // Of the layers; null where it does not know the tip, or the row is not the surface.
  std::shared_ptr<const LayeredTouch> exact_touch(const Fingertip&) const;
  SolidTissue tissue_;
  std::shared_ptr<Factor> factor_;
  std::shared_ptr<const SolidModulus<T>> modulus_;
  std::shared_ptr<Row> row_;
  LayersDrift drift_;
  const Known layered_;       // that learns nothing
  bool felt_ = false;         // of who corrects
  mutable std::mutex mutex_;  // of the pointers
  Known frictionless_, stuck_;
  std::shared_ptr<const FeltForce> felt_force_;
  std::atomic<std::size_t> corrections_ = 0;
};

}  // namespace teletact::service
