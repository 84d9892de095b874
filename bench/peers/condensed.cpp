// Ours: the surface compliance by layer-by-layer elimination, then unilateral contact with its tangent. Finds
// the nodes that touch by itself; its set-up includes computing the stiffness.
#include <optional>

#include "bench/peers/peer.h"
#include "service/tissue/tissue_model.h"

namespace teletact::bench {
namespace {

class Condensed final : public Peer {
 public:
  std::string name() const override { return "ours, condensed"; }
  bool ours() const override { return true; }
  double prepare(const ContactProblem& p) override {
    model_.emplace(p.tissue.grid, p.tissue.material, p.tissue.supports,
                   service::TissueModelOptions{.thickness_m = p.tissue.thickness_m});
    surface_ = model_->compliance(0);
    return -1;
  }
  PeerAnswer touch(const ContactProblem& p, double) override {
    const auto answer = service::solve_contact(model_->problem(), 0, *surface_, p.tip, p.pose);
    return {.force_n = {answer.force_n[0], answer.force_n[1]}, .stated_error = answer.solve.relative_error};
  }

  std::size_t kept_bytes() const override {
    const auto columns = model_->problem().touchable;
    const std::size_t unknowns = 2 * (columns.last - columns.first + 1);
    return unknowns * unknowns * sizeof(double);
  }

 private:
  std::optional<service::TissueModel> model_;
  std::shared_ptr<service::Compliance> surface_;
};

}  // namespace

std::unique_ptr<Peer> make_condensed() {
  return std::make_unique<Condensed>();
}

}  // namespace teletact::bench
