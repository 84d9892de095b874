// By which a client and a service know each other, and reach each other.
#pragma once

#include <functional>
#include <string>
#include <vector>

namespace teletact::client {

// Each is empty where it is not given.
struct Credentials {
  // PEM: the connection is encrypted, and the service must show a certificate that these authorities signed
  // for the host's name ("localhost" for a Unix socket). Without it nothing is encrypted.
  std::string tls_ca = {};
  std::string tls_certificate = {}, tls_key = {};  // PEM, the client's own; both or none, with tls_ca
  std::string token = {};                          // goes with every call
  bool proxy = false;  // by the proxy that the environment names; else past it, which would come between
};

// Throws std::runtime_error, one line with flag and remedy: half of a pair, a certificate without encryption,
// or a token that would leave this machine in the clear.
void require_usable(const Credentials&, const std::string& address);

// An option of a command line by which one of them is given: each is the path of a file, which `take` reads.
// It throws std::runtime_error, one line, for one that cannot be used.
struct CredentialOption {
  const char* flag;
  const char* description;
  std::function<void(const std::string& path)> take;
};
std::vector<CredentialOption> credential_options(Credentials&);  // which must outlive them

}  // namespace teletact::client
