// The service as one object: what main.cpp runs and the tests start in their own process.
#pragma once

#include <grpcpp/server.h>
#include <grpcpp/server_builder.h>

#include <memory>
#include <string>
#include <vector>

#include "service/rpc/core.h"
#include "service/rpc/free_memory.h"

namespace teletact::service {

class HealthService;
class UnknownMethods;

class Server {
 public:
  // Listens, with health NOT_SERVING. Throws std::runtime_error (one line) for an address, a file of TLS,
  // or of access, or a state folder that cannot be used. `devices`: at least one, by their numbers.
  Server(const std::vector<std::shared_ptr<Device>>& devices, const ServerOptions&);
  ~Server();  // drains
  // compile_steps() that make_ready() takes with double precision, on PoCL.
  static constexpr std::size_t kCompileSteps = 171;
  // Warms the kernels, restores the scenes, then health is SERVING.
  void make_ready();
  // Health NOT_SERVING and not ready, so that proxies send nobody else; all is served.
  void leave();
  // After leave(): what changes scenes is given up, they are written, and their folder is given to the
  // service that stands by. Calls that come are told (UNAVAILABLE), touches that they are to move; these are
  // answered until drain().
  void move();
  // Health NOT_SERVING, calls told (UNAVAILABLE), what is worked on given up, then closed; returns within
  // twice the limit drain_s and a little, but for a driver that hangs.
  void drain();
  const std::string& address() const { return address_; }
  Core& core() { return *core_; }

 private:
  void set_health(bool serving);
  void tell_devices(bool work);
  std::shared_ptr<void> held_;  // the socket; first: until nobody listens
  std::shared_ptr<grpc::ServerCredentials> credentials_;
  std::unique_ptr<Core> core_;
  std::vector<std::unique_ptr<grpc::Service>> services_;
  std::unique_ptr<HealthService> health_;
  std::unique_ptr<UnknownMethods> unknown_;
  std::unique_ptr<grpc::experimental::ExternalConnectionAcceptor> acceptor_;
  std::unique_ptr<grpc::Server> server_;
  FreeMemory free_memory_;
  std::string address_;
  bool drained_ = false;
};

}  // namespace teletact::service
