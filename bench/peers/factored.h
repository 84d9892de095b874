// Contact from any sparse factor of K fixed on its supports (T4.2): S = B K^-1 B^T among the nodes that
// touch.
#pragma once

#include <Eigen/Cholesky>
#include <stdexcept>
#include <utility>

#include "bench/peers/peer.h"

namespace teletact::bench {

// Factor: an Eigen sparse solver with compute(), info() and solve().
template <class Factor>
class Factored final : public Peer {
 public:
  explicit Factored(std::string name) : name_(std::move(name)) {}
  std::string name() const override { return name_; }
  double prepare(const ContactProblem& p) override {
    factor_ = std::make_unique<Factor>();
    factor_->compute(p.stiffness);
    if (factor_->info() != Eigen::Success) throw std::domain_error(name_ + ": the factorisation failed");
    return -1;
  }
  PeerAnswer touch(const ContactProblem& p, double) override {
    const auto size = p.overlap_m.size();
    Eigen::MatrixXd rows = Eigen::MatrixXd::Zero(p.stiffness.rows(), size);
    for (Eigen::Index r = 0; r < size; ++r) rows(dof(p, r), r) = 1;
    const Eigen::MatrixXd columns = factor_->solve(rows);
    Eigen::MatrixXd compliance(size, size);
    for (Eigen::Index r = 0; r < size; ++r) compliance.row(r) = columns.row(dof(p, r));
    const Eigen::VectorXd push = compliance.ldlt().solve(p.overlap_m);
    return {.force_n = p.force_n(-push), .displacement_m = columns * push};
  }
  bool condense_surface(const ContactProblem& p) override {
    const auto size = static_cast<Eigen::Index>(2 * p.tissue.grid.nx());
    const Eigen::MatrixXd columns = factor_->solve(Eigen::MatrixXd::Identity(p.stiffness.rows(), size));
    surface_ = columns.topRows(size);  // the surface's nodes come first
    return true;
  }
  bool solve_once(const ContactProblem& p) override {
    Eigen::VectorXd load = Eigen::VectorXd::Zero(p.stiffness.rows());
    load[dof(p, 0)] = 1;
    once_ = factor_->solve(load);
    return true;
  }

 private:
  static Eigen::Index dof(const ContactProblem& p, Eigen::Index r) {
    return static_cast<Eigen::Index>(p.contact_dofs[static_cast<std::size_t>(r)]);
  }
  std::string name_;
  std::unique_ptr<Factor> factor_;
  Eigen::MatrixXd surface_;
  Eigen::VectorXd once_;
};

}  // namespace teletact::bench
