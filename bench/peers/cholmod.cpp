// CHOLMOD (SuiteSparse), simplicial LDL^T and supernodal LL^T, where it was found at configure time. The
// supernodal part is GPL: it is linked into the benchmark alone. Its BLAS is held to one thread, as every
// host method here is.
#include "bench/peers/linear_solver.h"
#include "bench/peers/peer.h"

#ifdef TELETACT_BENCH_CHOLMOD
#include <dlfcn.h>

#include <Eigen/CholmodSupport>

#include "bench/peers/factored.h"

namespace teletact::bench {
namespace {

std::string with_one_thread(const std::string& name) {
  using SetThreads = void (*)(int);
  if (const auto set = reinterpret_cast<SetThreads>(dlsym(RTLD_DEFAULT, "openblas_set_num_threads")))
    return set(1), name + ", OpenBLAS";
  return name + ", BLAS as installed";
}

template <class Factor>
std::unique_ptr<Peer> make(const std::string& name) {
  return std::make_unique<Factored<Factor>>(with_one_thread(name));
}

class Factorised final : public LinearSolver {
 public:
  std::string name() const override { return name_; }
  bool iterative() const override { return false; }
  void prepare(const Eigen::SparseMatrix<double>& k) override {
    factor_.compute(k);
    if (factor_.info() != Eigen::Success) throw std::domain_error(name_ + ": the factorisation failed");
  }
  Eigen::VectorXd solve(const Eigen::VectorXd& f, int) override { return factor_.solve(f); }

 private:
  const std::string name_ = with_one_thread("CHOLMOD supernodal");
  Eigen::CholmodSupernodalLLT<Eigen::SparseMatrix<double>> factor_;
};

}  // namespace

std::unique_ptr<LinearSolver> make_cholmod_factor(std::string&) {
  return std::make_unique<Factorised>();
}

std::unique_ptr<Peer> make_cholmod_simplicial(std::string&) {
  return make<Eigen::CholmodSimplicialLDLT<Eigen::SparseMatrix<double>>>("CHOLMOD simplicial");
}

std::unique_ptr<Peer> make_cholmod_supernodal(std::string&) {
  return make<Eigen::CholmodSupernodalLLT<Eigen::SparseMatrix<double>>>("CHOLMOD supernodal");
}

}  // namespace teletact::bench

#else

namespace teletact::bench {
namespace {
constexpr const char* kAbsent =
    ": libsuitesparse was not found when teletact was configured; install libsuitesparse-dev and "
    "libopenblas0";
}

std::unique_ptr<LinearSolver> make_cholmod_factor(std::string& absent) {
  absent = std::string("CHOLMOD") + kAbsent;
  return nullptr;
}

std::unique_ptr<Peer> make_cholmod_simplicial(std::string& absent) {
  absent = std::string("CHOLMOD simplicial") + kAbsent;
  return nullptr;
}

std::unique_ptr<Peer> make_cholmod_supernodal(std::string& absent) {
  absent = std::string("CHOLMOD supernodal") + kAbsent;
  return nullptr;
}

}  // namespace teletact::bench
#endif
