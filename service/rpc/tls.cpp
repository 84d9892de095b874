#include "service/rpc/tls.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <grpcpp/security/tls_certificate_provider.h>
#include <grpcpp/security/tls_credentials_options.h>
#include <spdlog/spdlog.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cerrno>
#include <stdexcept>
#include <system_error>
#include <utility>

#include "common/small_file.h"
#include "service/access/certificates.h"
#include "service/rpc/call_of_connection.h"

namespace teletact::service {
namespace {

std::string read_pem(const char* flag, const std::filesystem::path& path) {
  std::string text;
  try {
    text = read_small_file(path, TlsFiles::kMaxBytes);
  } catch (const UnreadFile& error) {
    throw std::runtime_error(
        fmt::format("{} {}: cannot be read ({}); give a PEM file", flag, path.string(), error.what()));
  }
  if (text.find("-----BEGIN") == std::string::npos)
    throw std::runtime_error(fmt::format("{} {}: cannot be read as PEM", flag, path.string()));
  return text;
}

[[noreturn]] void fail() {
  throw std::runtime_error("--tls-certificate: no copy for gRPC can be made in memory: " +
                           std::generic_category().message(errno));
}

}  // namespace

void TlsFiles::Copy::put(const std::string& text) {
  FileDescriptor made(::memfd_create("teletact-tls", MFD_CLOEXEC));
  if (!made) fail();
  for (std::size_t done = 0; done < text.size();) {
    const ssize_t wrote = ::write(made.get(), text.data() + done, text.size() - done);
    if (wrote < 0 && errno != EINTR) fail();
    if (wrote > 0) done += static_cast<std::size_t>(wrote);
  }
  if (!file_)
    file_ = std::move(made);
  else if (::dup3(made.get(), file_.get(), O_CLOEXEC) < 0)
    fail();
}

TlsFiles::Texts TlsFiles::texts() const {
  const ListenOptions& o = options_;
  return {.key = read_pem("--tls-key", o.tls_key),
          .certificate = read_pem("--tls-certificate", o.tls_certificate),
          .client_ca = o.tls_client_ca.empty() ? "" : read_pem("--tls-client-ca", o.tls_client_ca)};
}

// gRPC finds out at the first handshake, and then says so to nobody.
void TlsFiles::require_fit(const Texts& texts) const {
  const ListenOptions& o = options_;
  try {
    require_pair(texts.certificate, texts.key);
  } catch (const std::runtime_error& error) {
    throw std::runtime_error(fmt::format("--tls-certificate {}, --tls-key {}: the TLS files do not fit: {}",
                                         o.tls_certificate.string(), o.tls_key.string(), error.what()));
  }
  try {
    if (!texts.client_ca.empty()) end_of(texts.client_ca);
  } catch (const std::runtime_error& error) {
    throw std::runtime_error(fmt::format("--tls-client-ca {}: {}", o.tls_client_ca.string(), error.what()));
  }
}

TlsFiles::TlsFiles(ListenOptions options, std::chrono::milliseconds between) : options_(std::move(options)) {
  put(texts());
  if (::access(key().c_str(), R_OK) != 0) fail();
  watch_.emplace(between, "tls_not_read", [this] { look(); });
}

void TlsFiles::put(const Texts& texts) {
  require_fit(texts);
  key_.put(texts.key);
  certificate_.put(texts.certificate);
  if (!texts.client_ca.empty()) client_ca_.put(texts.client_ca);
  put_ = texts;
}

void TlsFiles::look() {
  const Texts now = texts();
  if (now == put_) return;
  put(now);
  spdlog::info("event=tls_read certificate=\"{}\"", options_.tls_certificate.string());
}

std::shared_ptr<grpc::ServerCredentials> credentials_of(const ListenOptions& o) {
  if (o.tls_certificate.empty()) return clear_credentials();
  constexpr unsigned kLookS = 1;  // at the copies
  struct Kept {
    explicit Kept(const ListenOptions& options) : files(options) {}
    TlsFiles files;
    std::shared_ptr<grpc::ServerCredentials> credentials;
  };
  const auto kept = std::make_shared<Kept>(o);
  using namespace grpc::experimental;
  TlsServerCredentialsOptions options(std::make_shared<FileWatcherCertificateProvider>(
      kept->files.key(), kept->files.certificate(), kept->files.client_ca(), kLookS));
  options.watch_identity_key_cert_pairs();
  if (!o.tls_client_ca.empty()) {
    options.watch_root_certs();
    options.set_cert_request_type(GRPC_SSL_REQUEST_AND_REQUIRE_CLIENT_CERTIFICATE_AND_VERIFY);
  }
  kept->credentials = TlsServerCredentials(options);
  return {kept, kept->credentials.get()};
}

}  // namespace teletact::service
