import { post } from '../api/client';
import { toast, toastError } from '../state/toasts';
import { Icon } from './icons';

/** Always there, one click, no question asked: every drone that is armed holds where it is. */
export function AllStop() {
  const stop = async () => {
    try {
      const { commands } = await post('/v1/all-stop');
      toast('warn', `All stop: ${commands.length} armed ${commands.length === 1 ? 'drone' : 'drones'} told to hold`);
    } catch (error) {
      toastError(error);
    }
  };
  return (
    <button type="button" class="all-stop" title="Every drone holds where it is" onClick={() => void stop()}>
      <Icon name="stop" />
      All stop
    </button>
  );
}
