// Certificates for tests alone, good for localhost and 127.0.0.1 from 2020 to 2120: a bare machine has no
// openssl. The key protects nothing: it is published here.
#pragma once

namespace teletact::test {

inline constexpr const char* kCertificate = R"(-----BEGIN CERTIFICATE-----
MIIBYzCCAQmgAwIBAgIUbrTLc1ysNKQfhrYoxbbz8j4S8bowCgYIKoZIzj0EAwIw
GDEWMBQGA1UEAwwNdGVsZXRhY3QgdGVzdDAgFw0yMDAxMDEwMDAwMDBaGA8yMTIw
MDEwMTAwMDAwMFowGDEWMBQGA1UEAwwNdGVsZXRhY3QgdGVzdDBZMBMGByqGSM49
AgEGCCqGSM49AwEHA0IABKB+TW2++b07xUQgtSTbPocIh7txZVC7Ccd95SKGw6qu
5Sk1gPDaTpZqN3uOWnbFKFV5czcCin+JZ7WNxBU5OAejLzAtMA8GA1UdEwEB/wQF
MAMBAf8wGgYDVR0RBBMwEYIJbG9jYWxob3N0hwR/AAABMAoGCCqGSM49BAMCA0gA
MEUCICheOYRVIyEDafsHMTgaOuyotAC35bi5ubrRlDvkJqhtAiEAj1GCajTd7yRq
rFvPxYXrdA7cHnurqE4KOMnjTvPEYGM=
-----END CERTIFICATE-----
)";

inline constexpr const char* kCertificateKey = R"(-----BEGIN PRIVATE KEY-----
MIGHAgEAMBMGByqGSM49AgEGCCqGSM49AwEHBG0wawIBAQQgBCCtyRp/bUr7G/fP
RIvkS0x8HckU6IURSv+hkrO9symhRANCAASgfk1tvvm9O8VEILUk2z6HCIe7cWVQ
uwnHfeUihsOqruUpNYDw2k6Wajd7jlp2xShVeXM3Aop/iWe1jcQVOTgH
-----END PRIVATE KEY-----
)";

// Another authority, which signed nothing here.
inline constexpr const char* kForeignCertificate = R"(-----BEGIN CERTIFICATE-----
MIIBdTCCARugAwIBAgIUXv2g841OjeP3PZW74NljShTb0G4wCgYIKoZIzj0EAwIw
ITEfMB0GA1UEAwwWdGVsZXRhY3QgdGVzdCwgYW5vdGhlcjAgFw0yMDAxMDEwMDAw
MDBaGA8yMTIwMDEwMTAwMDAwMFowITEfMB0GA1UEAwwWdGVsZXRhY3QgdGVzdCwg
YW5vdGhlcjBZMBMGByqGSM49AgEGCCqGSM49AwEHA0IABPCtzTKx9YMIC2lQeqzT
OxTiK4j2kRQpGgGEsrji1w74FCr4q2e/eWJPkoQzYZTNKMrq3SLdgfNjES6nBFQ/
ClOjLzAtMA8GA1UdEwEB/wQFMAMBAf8wGgYDVR0RBBMwEYIJbG9jYWxob3N0hwR/
AAABMAoGCCqGSM49BAMCA0gAMEUCIQD5Lj7sJuW8FsSqriDwe8JgLHZm/OcxBn3W
KnfkK1Fp1wIgFIISyqMl68vD1HC4pT3Ym+YIflnWg33F7pWz7NHhHRk=
-----END CERTIFICATE-----
)";

}  // namespace teletact::test
