// Certificates that tests need, made by the program openssl.
#pragma once

#include <cstdlib>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <string>

#include "tests/access/access_folder.h"

namespace teletact::service {

struct Identity {
  std::string certificate, key;  // PEM
};

// Holds for a day. `wishes`: options of openssl req.
inline Identity make_identity(const std::string& name, const std::string& wishes, const Identity* authority) {
  const AccessFolder folder;
  const auto text_of = [&](const char* file) {
    std::ifstream in(folder / file);
    return std::string{std::istreambuf_iterator<char>(in), {}};
  };
  folder.put("config", "[req]\ndistinguished_name = given\n[given]\n");
  std::string command =
      "cd '" + (folder / "").string() +
      "' && openssl req -x509 -config config -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes "
      "-days 1 -keyout key.pem -out cert.pem -subj '/CN=" +
      name + "' " + wishes;
  if (authority) {
    folder.put("ca.pem", authority->certificate);
    folder.put("ca-key.pem", authority->key);
    command += " -CA ca.pem -CAkey ca-key.pem";
  }
  if (std::system((command + " >said 2>&1").c_str()) != 0) throw std::runtime_error(text_of("said"));
  return {text_of("cert.pem"), text_of("key.pem")};
}

// Signs others.
inline Identity make_authority(const std::string& name) {
  return make_identity(name, "-addext basicConstraints=critical,CA:TRUE", nullptr);
}
// For a service of this machine.
inline Identity make_server(const Identity& authority) {
  return make_identity(
      "localhost", "-addext extendedKeyUsage=serverAuth -addext subjectAltName=DNS:localhost,IP:127.0.0.1",
      &authority);
}
inline Identity make_client(const Identity& authority, const std::string& name) {
  return make_identity(name, "-addext extendedKeyUsage=clientAuth", &authority);
}

}  // namespace teletact::service
