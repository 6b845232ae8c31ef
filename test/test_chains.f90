!> Effective draws and potential scale reduction against ArviZ 0.23.4, and the tail of weights
!> against its Pareto-smoothed importance sampling, on numbers that both make alike.
program test_chains
   use beamid_chains, only: diagnose_chains, quantile
   use beamid_kinds, only: wp
   use beamid_pareto, only: smooth_weights
   use beamid_strings, only: to_text
   use checks, only: check, check_close, finish
   use lehmer_sequences, only: ar, gauss, uniform
   implicit none

   call test_arviz()
   call test_odd_length()
   call test_constant()
   call test_quantile()
   call test_weights()
   call test_tail_of_zeros()
   call finish('chains')

contains

   !> ar(n*m, phi, seed).reshape(m, n), and in Python
   !> az.ess(x, method='bulk'), az.ess(x, method='tail'), az.rhat(x, method='rank').
   !> 1e-9: the normal quantile of scipy and of this library to 1e-15, sums of up to 2000 terms;
   !> a sum of correlations of AR(1) .9 takes some 50 of them.
   subroutine test_arviz()
      call compare('independent', chains_of(250, 4, 0.0_wp, 1), 1040.6998018294073_wp, &
         984.516903407535_wp, 0.9998497303033678_wp)
      call compare('AR(1) .9', chains_of(500, 4, 0.9_wp, 2), 112.59541742095743_wp, &
         360.49305056948185_wp, 1.0475887105901407_wp)
      call compare('AR(1) -.5', chains_of(400, 4, -0.5_wp, 3), 5126.591972249479_wp, &
         1646.5838124752106_wp, 0.9990080898224609_wp)
      ! x + .3*np.arange(4)[:, None]
      call compare('means apart', chains_of(200, 4, 0.0_wp, 4) + spread(0.3_wp*[0, 1, 2, 3], 1, &
         200), 47.842470735269366_wp, 579.9729771173851_wp, 1.0669013939658627_wp)
      ! np.floor(2*x): ranks of equal draws are averaged
      call compare('ties', real(floor(2*chains_of(300, 4, 0.5_wp, 5)), wp), 432.0116430871814_wp, &
         571.1298640998771_wp, 1.0052628318501686_wp)
      ! x*(1 + np.arange(4))[:, None]: places agree, and only the folded draws tell
      call compare('spreads apart', chains_of(200, 4, 0.0_wp, 7)*spread(1.0_wp*[1, 2, 3, 4], 1, &
         200), 833.4815507174218_wp, 181.19886193826824_wp, 1.1552823841395141_wp)
   end subroutine test_arviz

   subroutine compare(name, x, bulk, tail, reduction)
      character(len=*), intent(in) :: name
      real(wp), intent(in) :: x(:, :), bulk, tail, reduction
      real(wp) :: found(3)

      call diagnose_chains(x, found(1), found(2), found(3))
      call check_close(name//': bulk', found(1)/bulk, 1.0_wp, 1e-9_wp)
      call check_close(name//': tail', found(2)/tail, 1.0_wp, 1e-9_wp)
      call check_close(name//': scale reduction', found(3), reduction, 1e-9_wp)
   end subroutine compare

   !> (n, m) one sequence cut into chains.
   function chains_of(n, m, phi, seed) result(x)
      integer, intent(in) :: n, m, seed
      real(wp), intent(in) :: phi
      real(wp) :: x(n, m)

      x = reshape(ar(n*m, phi, seed), [n, m])
   end function chains_of

   !> 251 draws of each chain: the one in the middle counts in neither half. The two draws beside
   !> the median are equally far from it. In ArviZ their distances differ by round-off, so that
   !> their ranks differ, and the reduction is 1.0005508658824152. The value below is that of the
   !> same formulas in NumPy with equal ranks.
   subroutine test_odd_length()
      call compare('odd', chains_of(251, 3, 0.5_wp, 6), 294.2181532136634_wp, &
         418.8104571575183_wp, 1.0005473394369693_wp)
   end subroutine test_odd_length

   !> Draws that are all the same: nothing is known against them, and nothing is divided by 0.
   subroutine test_constant()
      real(wp) :: x(40, 4), bulk, tail, reduction

      x = 0.1_wp
      call diagnose_chains(x, bulk, tail, reduction)
      call check_close('constant: bulk', bulk, 160.0_wp, 0.0_wp)
      call check_close('constant: tail', tail, 160.0_wp, 0.0_wp)
      call check_close('constant: scale reduction', reduction, 1.0_wp, 0.0_wp)
      ! Each chain stands still, and elsewhere than the others: four draws are worth four, or so.
      x = spread([1.0_wp, 2.0_wp, 3.0_wp, 4.0_wp], 1, 40)
      call diagnose_chains(x, bulk, tail, reduction)
      call check('stuck chains: hardly an effective draw', bulk < 10, to_text(bulk))
      call check('stuck chains: they do not agree', reduction > 1.1_wp, to_text(reduction))
   end subroutine test_constant

   !> np.quantile([1, 2, 4, 8], p): 1, 1.75, 3, 7.4, 8.
   subroutine test_quantile()
      real(wp), parameter :: p(5) = [0.0_wp, 0.25_wp, 0.5_wp, 0.95_wp, 1.0_wp], &
         q(5) = [1.0_wp, 1.75_wp, 3.0_wp, 7.4_wp, 8.0_wp]
      integer :: k

      do k = 1, size(p)
         call check_close('quantile '//to_text(p(k)), quantile([1.0_wp, 2.0_wp, 4.0_wp, 8.0_wp], &
            p(k)), q(k), 1e-14_wp)
      end do
      call check_close('quantile of one', quantile([3.0_wp], 0.9_wp), 3.0_wp, 0.0_wp)
   end subroutine test_quantile

   !> log_weight = -s*np.log(uniform(n, seed)), a Pareto law of shape s;
   !> w, k = az.psislw(log_weight); w = np.exp(w); k, w.max(), (w**2).sum(), (w*np.arange(1, n +
   !> 1)).sum(). The numbers of draws are such that the length of the tail, min(n/5, 3 sqrt(n)), is
   !> a whole one: ArviZ takes the next above, this library the next below. 1e-9: logarithms of 1 -
   !> theta x lose some six digits where theta x is small.
   subroutine test_weights()
      call compare_weights(400, 11, 0.5_wp, 0.8356875147874524_wp, 0.10043846656333451_wp, &
         0.01581614539205546_wp, 182.0295716859372_wp)
      call compare_weights(2500, 12, 1.0_wp, 1.1473814439619592_wp, 0.29130526117544386_wp, &
         0.09967255899252266_wp, 884.870275762017_wp)
      call compare_weights(100, 13, 2.0_wp, 2.584697470890869_wp, 0.912354789693526_wp, &
         0.8355072671869505_wp, 4.670970227574012_wp)
      call compare_weights(2500, 14, 0.05_wp, 0.06840279570824512_wp, 0.0005987020527469567_wp, &
         0.00040127556697348296_wp, 1250.2182966760133_wp)
   end subroutine test_weights

   subroutine compare_weights(n, seed, s, k, largest, squares, place)
      integer, intent(in) :: n, seed
      real(wp), intent(in) :: s, k, largest, squares, place
      character(len=:), allocatable :: label
      real(wp) :: w(n), found
      integer :: i

      label = 'weights of shape '//to_text(s)//', '//to_text(n)//': '
      call smooth_weights(1e4_wp - s*log(uniform(n, seed)), w, found)
      call check_close(label//'k', found, k, 1e-9_wp)
      call check_close(label//'largest', maxval(w)/largest, 1.0_wp, 1e-9_wp)
      call check_close(label//'squares', sum(w**2)/squares, 1.0_wp, 1e-9_wp)
      call check_close(label//'mean place', sum([(i*w(i), i=1, n)])/place, 1.0_wp, 1e-9_wp)
   end subroutine compare_weights

   !> Weights of which most are zero, or many equal.
   subroutine test_tail_of_zeros()
      real(wp), parameter :: impossible = -huge(1.0_wp)
      real(wp) :: log_weight(400), w(400), k

      ! np.floor(4*gauss(400, 15))/2; the weights are left out of it: which of equal ones is which
      ! decides.
      log_weight = floor(4*gauss(400, 15))/2.0_wp
      call smooth_weights(log_weight, w, k)
      call check_close('ties: k', k, 0.8821509000063403_wp, 1e-9_wp)
      call check_close('ties: sum', sum(w), 1.0_wp, 1e-13_wp)
      ! Heavy tails among draws that are impossible: the shape must say so, as ArviZ does: lw =
      ! np.full(400, -np.inf); lw[:40] = -2*np.log(uniform(40, 16)).
      log_weight = impossible
      log_weight(:40) = -2*log(uniform(40, 16))
      call smooth_weights(log_weight, w, k)
      call check_close('mostly zeros: k', k, 1.580308007084171_wp, 1e-9_wp)
      call check('mostly zeros: they stay', all(w(41:) <= 0) .and. all(w(:40) > 0))
      log_weight = 3
      call smooth_weights(log_weight, w, k)
      call check('all equal: no tail', k < 0 .and. all(abs(w - 1/400.0_wp) < 1e-15_wp), to_text(k))
      log_weight = impossible
      log_weight(7) = -5
      call smooth_weights(log_weight, w, k)
      call check('one possible: all the weight', abs(w(7) - 1) <= 0 .and. sum(w) <= 1, to_text(k))
      call smooth_weights(log_weight(:3), w(:3), k)
      call check('three draws: no tail', k < 0)
   end subroutine test_tail_of_zeros

end program test_chains
