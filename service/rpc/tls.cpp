#include "service/rpc/tls.h"

#include <fmt/format.h>
#include <grpcpp/security/tls_certificate_provider.h>
#include <grpcpp/security/tls_credentials_options.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <string>

#include "service/access/certificates.h"

namespace teletact::service {

namespace {

constexpr unsigned kLookS = 1;  // at the files

std::string read_pem(const char* flag, const std::filesystem::path& path) {
  if (!std::filesystem::exists(path))
    throw std::runtime_error(
        fmt::format("{} {}: is missing; give the path of a PEM file", flag, path.string()));
  std::ifstream in(path, std::ios::binary);
  if (!in) throw std::runtime_error(fmt::format("{} {}: {}", flag, path.string(), std::strerror(errno)));
  std::string text{std::istreambuf_iterator<char>(in), {}};
  if (!in || text.find("-----BEGIN") == std::string::npos)
    throw std::runtime_error(fmt::format("{} {}: cannot be read as PEM", flag, path.string()));
  return text;
}

// gRPC finds out at the first handshake, and then says so to nobody.
void require_files_fit(const ListenOptions& o) {
  const std::string key = read_pem("--tls-key", o.tls_key);
  const std::string certificate = read_pem("--tls-certificate", o.tls_certificate);
  try {
    require_pair(certificate, key);
  } catch (const std::runtime_error& error) {
    throw std::runtime_error(fmt::format("--tls-certificate {}, --tls-key {}: the TLS files do not fit: {}",
                                         o.tls_certificate.string(), o.tls_key.string(), error.what()));
  }
  if (o.tls_client_ca.empty()) return;
  try {
    end_of(read_pem("--tls-client-ca", o.tls_client_ca));
  } catch (const std::runtime_error& error) {
    throw std::runtime_error(fmt::format("--tls-client-ca {}: {}", o.tls_client_ca.string(), error.what()));
  }
}

}  // namespace

std::shared_ptr<grpc::ServerCredentials> credentials_of(const ListenOptions& o) {
  if (o.tls_certificate.empty()) return grpc::InsecureServerCredentials();
  require_files_fit(o);
  using namespace grpc::experimental;
  TlsServerCredentialsOptions options(std::make_shared<FileWatcherCertificateProvider>(
      o.tls_key.string(), o.tls_certificate.string(), o.tls_client_ca.string(), kLookS));
  options.watch_identity_key_cert_pairs();
  if (!o.tls_client_ca.empty()) {
    options.watch_root_certs();
    options.set_cert_request_type(GRPC_SSL_REQUEST_AND_REQUIRE_CLIENT_CERTIFICATE_AND_VERIFY);
  }
  return TlsServerCredentials(options);
}

}  // namespace teletact::service
