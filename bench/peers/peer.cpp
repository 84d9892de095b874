#include "bench/peers/peer.h"

namespace teletact::bench {

Peers make_peers(const std::shared_ptr<service::Device>& device) {
  Peers peers;
  const auto add = [&](std::unique_ptr<Peer> peer, const std::string& absent) {
    if (peer)
      peers.all.push_back(std::move(peer));
    else
      peers.absent.push_back(absent);
  };
  const auto optional = [&](auto make) {
    std::string absent;
    std::unique_ptr<Peer> peer = make(absent);
    add(std::move(peer), absent);
  };
  add(make_dense_lu(), {});
  optional(make_octave);
  add(make_eigen_ldlt(), {});
  optional(make_cholmod_simplicial);
  optional(make_cholmod_supernodal);
  add(make_eigen_cg_jacobi(), {});
  add(make_eigen_cg_incomplete_cholesky(), {});
  add(make_eigen_cg_uniform_factor(), {});
  optional([&](std::string& absent) { return make_viennacl(device, absent); });
  add(make_condensed(), {});
  using service::Precision;
  add(make_device_pcg(device, Precision::kFloat, false), {});
  add(make_device_pcg(device, Precision::kFloat, true), {});
  if (device->info().has_double) {
    add(make_device_pcg(device, Precision::kDouble, false), {});
  } else {
    peers.absent.push_back("device PCG in double: " + device->info().name + " has no double precision");
  }
  return peers;
}

}  // namespace teletact::bench
