#include "service/access/certificates.h"

#include <arpa/inet.h>
#include <openssl/bio.h>
#include <openssl/ec.h>
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/rand.h>
#include <openssl/x509.h>
#include <openssl/x509v3.h>

#include <ctime>
#include <memory>
#include <stdexcept>

namespace teletact::service {

namespace {

template <auto kFree>
struct Free {
  template <class T>
  void operator()(T* freed) const {
    kFree(freed);
  }
};
using Bio = std::unique_ptr<BIO, Free<BIO_free_all>>;
using Key = std::unique_ptr<EVP_PKEY, Free<EVP_PKEY_free>>;
using Certificate = std::unique_ptr<X509, Free<X509_free>>;
using Extension = std::unique_ptr<X509_EXTENSION, Free<X509_EXTENSION_free>>;

void require(bool done, const char* what) {
  if (!done) throw std::runtime_error(std::string("a certificate cannot be made: ") + what);
}

Bio reading(const std::string& pem) {
  return Bio(BIO_new_mem_buf(pem.data(), static_cast<int>(pem.size())));
}

Certificate certificate_in(const std::string& pem) {
  Certificate certificate(PEM_read_bio_X509(reading(pem).get(), nullptr, nullptr, nullptr));
  if (!certificate) throw std::runtime_error("no certificate can be read in it");
  return certificate;
}

// A key with a passphrase is none: nobody is there to type it.
Key key_in(const std::string& pem) {
  const auto no_passphrase = [](char*, int, int, void*) { return 0; };
  Key key(PEM_read_bio_PrivateKey(reading(pem).get(), nullptr, no_passphrase, nullptr));
  if (!key) throw std::runtime_error("no private key without a passphrase can be read in it");
  return key;
}

template <class Write>
std::string pem_by(Write&& write) {
  const Bio out(BIO_new(BIO_s_mem()));
  require(out && write(out.get()) == 1, "PEM");
  char* text = nullptr;
  const long size = BIO_get_mem_data(out.get(), &text);
  return {text, static_cast<std::size_t>(size)};
}

Key make_key() {
  Key key(EVP_EC_gen("P-256"));
  require(key != nullptr, "key");
  return key;
}

void add(X509* certificate, X509* authority, int kind, const std::string& value) {
  X509V3_CTX context;
  X509V3_set_ctx(&context, authority, certificate, nullptr, nullptr, 0);
  const Extension extension(X509V3_EXT_conf_nid(nullptr, &context, kind, value.c_str()));
  require(extension && X509_add_ext(certificate, extension.get(), -1) == 1, value.c_str());
}

void set_times(X509* certificate, WallClock::time_point end) {
  constexpr long kClocksApartS = 3600;  // another machine's clock may be behind
  const std::time_t at = WallClock::to_time_t(end);
  require(X509_gmtime_adj(X509_getm_notBefore(certificate), -kClocksApartS) != nullptr &&
              ASN1_TIME_set(X509_getm_notAfter(certificate), at) != nullptr,
          "time");
}

Certificate named(const std::string& name, EVP_PKEY* key, WallClock::time_point end) {
  constexpr long kVersion3 = 2;
  Certificate out(X509_new());
  require(out && X509_set_version(out.get(), kVersion3) == 1, "version");
  unsigned char serial[16];
  require(RAND_bytes(serial, sizeof(serial)) == 1, "serial number");
  serial[0] &= 0x7f;  // positive
  const std::unique_ptr<BIGNUM, Free<BN_free>> number(BN_bin2bn(serial, sizeof(serial), nullptr));
  require(number && BN_to_ASN1_INTEGER(number.get(), X509_get_serialNumber(out.get())) != nullptr,
          "serial number");
  set_times(out.get(), end);
  require(X509_NAME_add_entry_by_txt(X509_get_subject_name(out.get()), "CN", MBSTRING_UTF8,
                                     reinterpret_cast<const unsigned char*>(name.c_str()), -1, -1, 0) == 1,
          "name");
  require(X509_set_pubkey(out.get(), key) == 1, "key");
  return out;
}

Identity signed_by(Certificate certificate, const Key& key, X509* issuer, EVP_PKEY* issuer_key) {
  require(X509_set_issuer_name(certificate.get(), X509_get_subject_name(issuer)) == 1, "issuer");
  require(X509_sign(certificate.get(), issuer_key, EVP_sha256()) > 0, "signature");
  return {pem_by([&](BIO* out) { return PEM_write_bio_X509(out, certificate.get()); }), pem_by([&](BIO* out) {
            return PEM_write_bio_PKCS8PrivateKey(out, key.get(), nullptr, nullptr, 0, nullptr, nullptr);
          })};
}

// Signed by the authority, for `purpose`; `names` where it has alternative names.
Identity make_leaf(const Identity& authority, const std::string& name, const char* purpose,
                   const std::string& names, WallClock::time_point end) {
  const Certificate issuer = certificate_in(authority.certificate);
  const Key issuer_key = key_in(authority.key), key = make_key();
  Certificate out = named(name, key.get(), end);
  add(out.get(), issuer.get(), NID_basic_constraints, "critical,CA:FALSE");
  add(out.get(), issuer.get(), NID_key_usage, "critical,digitalSignature");
  add(out.get(), issuer.get(), NID_ext_key_usage, purpose);
  if (!names.empty()) add(out.get(), issuer.get(), NID_subject_alt_name, names);
  return signed_by(std::move(out), key, issuer.get(), issuer_key.get());
}

bool is_address(const std::string& host) {
  unsigned char bytes[sizeof(in6_addr)];
  return inet_pton(AF_INET, host.c_str(), bytes) == 1 || inet_pton(AF_INET6, host.c_str(), bytes) == 1;
}

}  // namespace

void require_pair(const std::string& certificate, const std::string& key) {
  const Certificate shown = certificate_in(certificate);
  const Key secret = key_in(key);
  if (X509_check_private_key(shown.get(), secret.get()) != 1)
    throw std::runtime_error("the key is not the certificate's");
}

WallClock::time_point end_of(const std::string& pem) {
  const Certificate certificate = certificate_in(pem);
  std::tm end{};
  if (ASN1_TIME_to_tm(X509_get0_notAfter(certificate.get()), &end) != 1)
    throw std::runtime_error("the certificate does not say when it ends");
  return WallClock::from_time_t(timegm(&end));
}

Identity make_authority(const std::string& name, WallClock::time_point end) {
  const Key key = make_key();
  Certificate out = named(name, key.get(), end);
  add(out.get(), out.get(), NID_basic_constraints, "critical,CA:TRUE,pathlen:0");
  add(out.get(), out.get(), NID_key_usage, "critical,keyCertSign,cRLSign");
  X509* const self = out.get();
  return signed_by(std::move(out), key, self, key.get());
}

Identity make_server(const Identity& authority, const std::vector<std::string>& hosts,
                     WallClock::time_point end) {
  std::string names;
  for (const std::string& host : hosts)
    names += (names.empty() ? "" : ",") + std::string(is_address(host) ? "IP:" : "DNS:") + host;
  return make_leaf(authority, hosts.front(), "serverAuth", names, end);
}

Identity make_client(const Identity& authority, const std::string& name, WallClock::time_point end) {
  return make_leaf(authority, name, "clientAuth", "", end);
}

}  // namespace teletact::service
