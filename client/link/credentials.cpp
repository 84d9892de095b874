#include "client/link/credentials.h"

#include <algorithm>
#include <cstddef>
#include <stdexcept>

#include "common/small_file.h"

namespace teletact::client {
namespace {

std::string text_of(const std::string& flag, const std::string& path) {
  constexpr std::size_t kMax = std::size_t{1} << 20;
  try {
    return read_small_stream(path, kMax);
  } catch (const UnreadFile& error) {
    throw std::runtime_error(flag + " " + path + ": " + error.what() + "; give a file that can be read");
  }
}

std::string read_pem(const std::string& flag, const std::string& path, const std::string& kind,
                     const std::string& remedy) {
  std::string text = text_of(flag, path);
  if (text.find(kind) == std::string::npos)
    throw std::runtime_error(flag + " " + path + ": no PEM " +
                             (kind.find("KEY") == std::string::npos ? "certificate" : "key") +
                             " can be read there; " + remedy);
  return text;
}

std::string read_token(const std::string& path) {
  constexpr std::size_t kMax = 512;
  std::string text = text_of("--token-file", path);
  while (!text.empty() && (text.back() == '\n' || text.back() == '\r' || text.back() == ' ')) text.pop_back();
  const bool fits = !text.empty() && text.size() <= kMax &&
                    std::all_of(text.begin(), text.end(), [](char c) { return c > ' ' && c <= '~'; });
  if (!fits)
    throw std::runtime_error("--token-file " + path +
                             ": no token can be read there; give a file with the token alone, one word");
  return text;
}

// Nobody else hears what is sent there.
bool on_this_machine(std::string address) {
  if (address.find(',') != std::string::npos) return false;  // one of several may be elsewhere
  for (const char* scheme : {"dns:", "ipv4:", "ipv6:"})
    if (address.rfind(scheme, 0) == 0) address.erase(0, std::string(scheme).size());
  const auto begins = [&address](const char* with) { return address.rfind(with, 0) == 0; };
  if (begins("unix:") || begins("unix-abstract:") || begins("[::1]:") || begins("localhost:")) return true;
  // A name may begin so, too: digits and points alone are an address.
  const std::string host = address.substr(0, address.rfind(':'));
  return begins("127.") && host.find_first_not_of("0123456789.") == std::string::npos;
}

}  // namespace

void require_usable(const Credentials& credentials, const std::string& address) {
  if (credentials.tls_certificate.empty() != credentials.tls_key.empty())
    throw std::runtime_error("--tls-certificate and --tls-key: give both or none");
  if (!credentials.tls_ca.empty()) return;
  if (!credentials.tls_certificate.empty())
    throw std::runtime_error(
        "--tls-certificate: it is shown on encrypted connections alone; give --tls-ca, too");
  if (!credentials.token.empty() && credentials.proxy)
    throw std::runtime_error(
        "--token-file: the proxy of --proxy could read the token without --tls-ca; give --tls-ca");
  if (!credentials.token.empty() && !on_this_machine(address))
    throw std::runtime_error("--token-file: " + address +
                             " is beyond this machine, and without --tls-ca others could read the token; "
                             "give --tls-ca");
}

std::vector<CredentialOption> credential_options(Credentials& c) {
  return {
      {"--tls-ca", "PEM certificate that signed the service's; without it nothing is encrypted",
       [&c](const std::string& path) {
         c.tls_ca =
             read_pem("--tls-ca", path, "-----BEGIN CERTIFICATE", "give the one that signed the service's");
       }},
      {"--tls-certificate",
       "PEM certificate by which the service knows this client; without it none is shown",
       [&c](const std::string& path) {
         c.tls_certificate =
             read_pem("--tls-certificate", path, "-----BEGIN CERTIFICATE", "give the one of this client");
       }},
      {"--tls-key", "PEM key of that certificate; without it none is shown",
       [&c](const std::string& path) {
         c.tls_key = read_pem("--tls-key", path, "PRIVATE KEY-----", "give the certificate's");
       }},
      {"--token-file", "file of the token by which the service knows this client; without it none is sent",
       [&c](const std::string& path) { c.token = read_token(path); }}};
}

}  // namespace teletact::client
