// One way to solve the contact problem, ours and others', behind one door, so that the chart treats all
// alike.
//
// Rivals are told which nodes touch (the reference's), and are given the assembled matrix: finding the
// contact and assembling cost them nothing. Host methods run on one thread; the device methods on all of the
// device.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "bench/peers/contact_case.h"
#include "service/device/device.h"

namespace teletact::bench {

struct PeerAnswer {
  std::array<double, 2> force_n{};   // on the finger
  Eigen::VectorXd displacement_m{};  // [dof]; empty where the method does not compute it
  std::size_t iterations = 0;
  double stated_error = 0;  // relative, in the energy norm; 0 where the method states none
  double seconds = -1;      // measured by the peer itself (a process of its own); < 0: by the caller
};

class Peer {
 public:
  virtual ~Peer() = default;
  virtual std::string name() const = 0;
  virtual bool ours() const { return false; }
  // It is what TissueModel::iterative solves with on this problem: promises are judged by it alone.
  virtual bool products_choice(const ContactProblem&) const { return false; }
  // Iterative: `tolerance` of touch means something (to itself), and smaller is more accurate.
  virtual bool iterative() const { return false; }
  // It is not run on more: that would take minutes.
  virtual std::size_t max_unknowns() const { return SIZE_MAX; }
  // Everything that depends on the modulus and may be kept between touches. Returns seconds that it measured
  // itself, < 0 where the caller is to.
  virtual double prepare(const ContactProblem&) = 0;
  // After prepare.
  virtual PeerAnswer touch(const ContactProblem&, double tolerance) = 0;
  // After prepare: the compliance among all surface nodes, both components. False: not something it does.
  virtual bool condense_surface(const ContactProblem&) { return false; }
  // After prepare: what is kept between touches, bytes; 0 where that is not known.
  virtual std::size_t kept_bytes() const { return 0; }
  // After prepare: one solve with K. False: not something it does.
  virtual bool solve_once(const ContactProblem&) { return false; }
};

struct Peers {
  std::vector<std::unique_ptr<Peer>> all;
  std::vector<std::string> absent;  // "CHOLMOD: not found when teletact was configured"
};
// Every method there is on this machine. `device`: for those that need one.
Peers make_peers(const std::shared_ptr<service::Device>& device);

// Factories, one file each; null where the method is absent, and why in `absent`.
std::unique_ptr<Peer> make_dense_lu();
std::unique_ptr<Peer> make_eigen_ldlt();
std::unique_ptr<Peer> make_eigen_cg_jacobi();
std::unique_ptr<Peer> make_eigen_cg_incomplete_cholesky();
std::unique_ptr<Peer> make_eigen_cg_uniform_factor();
std::unique_ptr<Peer> make_cholmod_simplicial(std::string& absent);
std::unique_ptr<Peer> make_cholmod_supernodal(std::string& absent);
std::unique_ptr<Peer> make_octave(std::string& absent);
std::unique_ptr<Peer> make_viennacl(const std::shared_ptr<service::Device>&, std::string& absent);
std::unique_ptr<Peer> make_condensed();
std::unique_ptr<Peer> make_device_pcg(const std::shared_ptr<service::Device>&, service::Precision,
                                      bool refined);

}  // namespace teletact::bench
