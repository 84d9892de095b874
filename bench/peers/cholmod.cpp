// CHOLMOD (SuiteSparse), simplicial LDL^T and supernodal LL^T, where it was found at configure time. The
// supernodal part is GPL: it is linked into the benchmark alone. Its BLAS is held to one thread, as every
// host method here is.
#include "bench/peers/peer.h"

#ifdef TELETACT_BENCH_CHOLMOD
#include <dlfcn.h>

#include <Eigen/CholmodSupport>

#include "bench/peers/factored.h"

namespace teletact::bench {
namespace {

template <class Factor>
std::unique_ptr<Peer> make(const std::string& name) {
  using SetThreads = void (*)(int);
  if (const auto set = reinterpret_cast<SetThreads>(dlsym(RTLD_DEFAULT, "openblas_set_num_threads")))
    return set(1), std::make_unique<Factored<Factor>>(name + ", OpenBLAS");
  return std::make_unique<Factored<Factor>>(name + ", BLAS as installed");
}

}  // namespace

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
