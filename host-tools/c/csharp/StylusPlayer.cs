// Textures and scenes of a library in real time, for .NET, Mono and Unity. See README.md.
//
// One file, without unsafe code. It needs the shared library: stylusplayer.dll, libstylusplayer.so or
// libstylusplayer.dylib, beside the program, or in Unity below Assets/Plugins.
using System;
using System.Runtime.InteropServices;
using System.Text;
using Microsoft.Win32.SafeHandles;

namespace Stylus
{
    /// <summary>A call that failed, with its status of stylus_player.h.</summary>
    public sealed class StylusException : Exception
    {
        public int Status { get; }

        internal StylusException(int status) : base(Native.Text(status)) { Status = status; }
    }

    /// <summary>A library. What plays from it may outlive it.</summary>
    public sealed class Library : IDisposable
    {
        internal readonly LibraryHandle Handle;

        /// <summary>Opens the library in a file.</summary>
        public Library(string path) { Native.Check(Native.stylus_library_open(Native.Utf8(path), out Handle)); }

        /// <summary>Decodes a library, such as the bytes of a TextAsset.</summary>
        public Library(byte[] bytes)
        {
            if (bytes == null) throw new ArgumentNullException(nameof(bytes));
            Native.Check(Native.stylus_library_decode(bytes, (UIntPtr)bytes.Length, out Handle));
        }

        public string[] Textures => Names(Native.Texture);

        public string[] Scenes => Names(Native.Scene);

        public void Dispose() { Handle.Dispose(); }

        internal UIntPtr Find(uint kind, string name)
        {
            Native.Check(Native.stylus_library_find(Handle, kind, Native.Utf8(name), out UIntPtr index));
            return index;
        }

        string[] Names(uint kind)
        {
            Native.Check(Native.stylus_library_count(Handle, kind, out UIntPtr count));
            var names = new string[(int)count];
            var name = new byte[64];
            for (int index = 0; index < names.Length; index++)
            {
                UIntPtr room = (UIntPtr)name.Length;
                Native.Check(Native.stylus_library_name(Handle, kind, (UIntPtr)index, name, room));
                names[index] = Native.FromUtf8(name);
            }
            return names;
        }
    }

    /// <summary>A player. One thread at a time may fill; any may do the rest.</summary>
    public sealed class Player : IDisposable
    {
        readonly PlayerHandle handle;

        /// <summary>A player at a multiple of 25 Hz from 1000 to 192000 Hz. asRendered leaves the DC blocker out, for
        /// the bits of `stylus render`.</summary>
        public Player(int outputRateHz, bool asRendered = false)
        {
            if (Native.stylus_player_abi() != Native.Abi)
                throw new InvalidOperationException("the library is of another version than StylusPlayer.cs");
            OutputRateHz = outputRateHz;
            uint rateHz = (uint)outputRateHz;
            Native.Check(asRendered
                ? Native.stylus_player_open_as_rendered(rateHz, out handle)
                : Native.stylus_player_open(rateHz, out handle));
        }

        public int OutputRateHz { get; }

        /// <summary>Plays a texture with the noise of a seed, as soon as what sounds has faded.</summary>
        public void Choose(Library library, string texture, ulong seed = 1)
        {
            Choose(library, Native.Texture, library.Find(Native.Texture, texture), seed);
        }

        /// <summary>Plays a scene in the same way.</summary>
        public void ChooseScene(Library library, string scene, ulong seed = 1)
        {
            Choose(library, Native.Scene, library.Find(Native.Scene, scene), seed);
        }

        /// <summary>Lets what sounds fade, and plays nothing until the next choice.</summary>
        public void Stop() { Native.Check(Native.stylus_player_stop(handle)); }

        /// <summary>Moves at a speed, mm/s, signed by the direction, with a force, N. It is held for 50 ms.</summary>
        public void Move(double speedMmS, double forceN)
        {
            Native.Check(Native.stylus_player_move(handle, speedMmS, forceN));
        }

        /// <summary>Moves to a position, mm, with a force, N, at a time of the caller's clock, s.</summary>
        public void Reach(double timeS, double positionMm, double forceN)
        {
            Native.Check(Native.stylus_player_reach(handle, timeS, positionMm, forceN));
        }

        /// <summary>Multiplies samples, m/s², by a gain, and clamps them to a limit on either side.</summary>
        public void SetGain(float gain, float limit)
        {
            Native.Check(Native.stylus_player_set_gain(handle, gain, limit));
        }

        /// <summary>Protects a coil: its resistance, the volts for each m/s², its lasting power. The output is then the
        /// coil's voltage, whose size, slew and power are limited for good.</summary>
        public void SetCoil(float ohms, float voltsPerMS2, float watts)
        {
            Native.Check(Native.stylus_player_set_coil(handle, ohms, voltsPerMS2, watts));
        }

        /// <summary>Plays the next samples into a part of an array. For the audio thread: it throws only for a part
        /// that is not there, allocates nothing, and returns whether it played; else the part is silent, such as after
        /// Dispose.</summary>
        public bool Fill(float[] samples, int offset, int count)
        {
            if (samples == null) throw new ArgumentNullException(nameof(samples));
            if (offset < 0 || count < 0 || offset > samples.Length - count)
                throw new ArgumentOutOfRangeException(nameof(count));
            if (count == 0) return true;
            if (Play(ref samples[offset], count)) return true;
            Array.Clear(samples, offset, count);
            return false;
        }

#if NETCOREAPP || NETSTANDARD2_1_OR_GREATER || UNITY_2021_2_OR_NEWER
        /// <summary>The same into a span.</summary>
        public bool Fill(Span<float> samples)
        {
            if (samples.IsEmpty || Play(ref MemoryMarshal.GetReference(samples), samples.Length)) return true;
            samples.Clear();
            return false;
        }
#endif

        /// <summary>Time from a move to the middle of its change, s, of a texture at 5000 or 10000 Hz: at most so much
        /// in the mean, and 1 ms more for a move just after a block began.</summary>
        public double LatencyS(int sampleRateHz)
        {
            Native.Check(Native.stylus_player_latency((uint)sampleRateHz, (uint)OutputRateHz, out double seconds));
            return seconds;
        }

        /// <summary>Band, Hz, that the output rate has left of a texture at 5000 or 10000 Hz.</summary>
        public double BandHz(int sampleRateHz)
        {
            Native.Check(Native.stylus_player_band((uint)sampleRateHz, (uint)OutputRateHz, out double hz));
            return hz;
        }

        public void Dispose() { handle.Dispose(); }

        // The first sample stays where it is during the call, and with it all of them.
        bool Play(ref float first, int count)
        {
            if (handle.IsClosed) return false;
            try
            {
                return Native.stylus_player_fill(handle, ref first, (UIntPtr)count) == 0;
            }
            catch (ObjectDisposedException)
            {
                // Another thread has disposed of the player since the line above.
                return false;
            }
        }

        void Choose(Library library, uint kind, UIntPtr index, ulong seed)
        {
            Native.Check(Native.stylus_player_choose(handle, library.Handle, kind, index, seed));
        }
    }

    /// <summary>Handle of a library. The runtime closes it when no call uses it any more.</summary>
    internal sealed class LibraryHandle : SafeHandleZeroOrMinusOneIsInvalid
    {
        LibraryHandle() : base(true) { }

        protected override bool ReleaseHandle() { return Native.stylus_library_close(handle) == 0; }
    }

    /// <summary>Handle of a player.</summary>
    internal sealed class PlayerHandle : SafeHandleZeroOrMinusOneIsInvalid
    {
        PlayerHandle() : base(true) { }

        protected override bool ReleaseHandle() { return Native.stylus_player_close(handle) == 0; }
    }

    /// <summary>The functions of stylus_player.h.</summary>
    internal static class Native
    {
        internal const uint Abi = 1, Texture = 0, Scene = 1;
        const string Name = "stylusplayer";

        internal static void Check(int status)
        {
            if (status != 0) throw new StylusException(status);
        }

        internal static byte[] Utf8(string text)
        {
            if (text == null) throw new ArgumentNullException(nameof(text));
            return Encoding.UTF8.GetBytes(text + "\0");
        }

        internal static string FromUtf8(byte[] text)
        {
            return Encoding.UTF8.GetString(text, 0, Math.Max(0, Array.IndexOf(text, (byte)0)));
        }

        internal static string Text(int status)
        {
            IntPtr address = stylus_status_text(status);
            int length = 0;
            while (Marshal.ReadByte(address, length) != 0) length++;
            var said = new byte[length];
            Marshal.Copy(address, said, 0, length);
            string text = Encoding.UTF8.GetString(said);
            var more = new byte[512];
            bool hasMore = stylus_last_text(more, (UIntPtr)more.Length) == 0 && more[0] != 0;
            return hasMore ? text + ": " + FromUtf8(more) : text;
        }

        [DllImport(Name)] internal static extern int stylus_library_open(byte[] path, out LibraryHandle library);
        [DllImport(Name)]
        internal static extern int stylus_library_decode(byte[] bytes, UIntPtr length, out LibraryHandle library);
        [DllImport(Name)] internal static extern int stylus_library_close(IntPtr library);
        [DllImport(Name)]
        internal static extern int stylus_library_count(LibraryHandle library, uint kind, out UIntPtr count);
        [DllImport(Name)]
        internal static extern int stylus_library_name(
            LibraryHandle library, uint kind, UIntPtr index, byte[] name, UIntPtr length);
        [DllImport(Name)]
        internal static extern int stylus_library_find(
            LibraryHandle library, uint kind, byte[] name, out UIntPtr index);
        [DllImport(Name)] internal static extern int stylus_player_open(uint outputRateHz, out PlayerHandle player);
        [DllImport(Name)]
        internal static extern int stylus_player_open_as_rendered(uint outputRateHz, out PlayerHandle player);
        [DllImport(Name)] internal static extern int stylus_player_close(IntPtr player);
        [DllImport(Name)]
        internal static extern int stylus_player_choose(
            PlayerHandle player, LibraryHandle library, uint kind, UIntPtr index, ulong seed);
        [DllImport(Name)] internal static extern int stylus_player_stop(PlayerHandle player);
        [DllImport(Name)]
        internal static extern int stylus_player_move(PlayerHandle player, double speedMmS, double forceN);
        [DllImport(Name)]
        internal static extern int stylus_player_reach(
            PlayerHandle player, double timeS, double positionMm, double forceN);
        [DllImport(Name)]
        internal static extern int stylus_player_set_gain(PlayerHandle player, float gain, float limit);
        [DllImport(Name)]
        internal static extern int stylus_player_set_coil(
            PlayerHandle player, float ohms, float voltsPerMS2, float watts);
        [DllImport(Name)]
        internal static extern int stylus_player_fill(PlayerHandle player, ref float first, UIntPtr length);
        [DllImport(Name)]
        internal static extern int stylus_player_latency(uint sampleRateHz, uint outputRateHz, out double seconds);
        [DllImport(Name)]
        internal static extern int stylus_player_band(uint sampleRateHz, uint outputRateHz, out double hz);
        [DllImport(Name)] internal static extern int stylus_last_text(byte[] buffer, UIntPtr length);
        [DllImport(Name)] internal static extern IntPtr stylus_status_text(int status);
        [DllImport(Name)] internal static extern uint stylus_player_abi();
    }
}
