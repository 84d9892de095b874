// The paper's method: the whole KKT system (T4.1) by Gaussian elimination with pivoting, for each touch anew.
#include "bench/peers/peer.h"
#include "tests/reference/kkt.h"

namespace teletact::bench {
namespace {

constexpr std::size_t kMaxDofs = 2200;  // 51x21 nodes: the paper's largest; n^3 leaves no sense in more

class DenseLu final : public Peer {
 public:
  std::string name() const override { return "dense LU of the KKT system"; }
  std::size_t max_unknowns() const override { return kMaxDofs; }
  double prepare(const ContactProblem& p) override {
    rows_.setZero(p.overlap_m.size(), p.stiffness.rows());
    for (Eigen::Index r = 0; r < rows_.rows(); ++r)
      rows_(r, static_cast<Eigen::Index>(p.contact_dofs[static_cast<std::size_t>(r)])) = 1;
    return -1;
  }
  PeerAnswer touch(const ContactProblem& p, double) override {
    const auto s =
        reference::solve_kkt(p.stiffness, rows_, Eigen::VectorXd::Zero(p.stiffness.rows()), p.overlap_m);
    return {.force_n = p.force_n(s.lambda), .displacement_m = s.x};
  }

 private:
  Eigen::MatrixXd rows_;
};

}  // namespace

std::unique_ptr<Peer> make_dense_lu() {
  return std::make_unique<DenseLu>();
}

}  // namespace teletact::bench
