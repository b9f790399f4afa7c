/* The one function of bcryptprimitives.dll that Rust's library needs, for Wine before 9.0, which lacks the DLL. */

#include <windows.h>
#include <ntsecapi.h>

__declspec(dllexport) BOOL WINAPI ProcessPrng(PBYTE data, SIZE_T length) {
    return RtlGenRandom(data, (ULONG)length);
}
